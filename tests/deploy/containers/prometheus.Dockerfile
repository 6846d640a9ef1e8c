# In the place of prom/prometheus: Debian's Prometheus.
FROM debian:bookworm-slim
RUN apt-get update \
    && apt-get install --no-install-recommends --yes prometheus wget \
    && install --directory --owner=nobody --group=nogroup /prometheus
VOLUME /prometheus
ENTRYPOINT ["prometheus"]
