# In the place of caddy: Debian's Caddy.
FROM debian:bookworm-slim
RUN apt-get update \
    && apt-get install --no-install-recommends --yes caddy libcap2-bin netcat-openbsd \
    && setcap cap_net_bind_service=+ep /usr/bin/caddy \
    && mkdir --parents /config/caddy /data/caddy
ENV XDG_CONFIG_HOME=/config XDG_DATA_HOME=/data
CMD ["caddy", "run", "--config", "/etc/caddy/Caddyfile", "--adapter", "caddyfile"]
