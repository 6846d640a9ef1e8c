# The service in a container. Two targets: `cpu` (the default) and `cuda`.
#
#     docker build --target cpu --tag fvs:cpu .
#     docker build --target cuda --tag fvs:cuda .

FROM python:3.11-slim-bookworm AS build-cpu
WORKDIR /source
RUN python -m venv /opt/fvs
COPY constraints.txt ./
# Extra options of pip. PyPI's torch is the CUDA build, several GB larger: name the index of the CPU builds here.
ARG PIP_OPTIONS=""
# hadolint ignore=SC2086
RUN /opt/fvs/bin/pip install --no-cache-dir $PIP_OPTIONS --constraint constraints.txt torch
COPY pyproject.toml README.md LICENSE ./
COPY fvs_engine fvs_engine
COPY services services
COPY clients/python clients/python
RUN /opt/fvs/bin/pip install --no-cache-dir --constraint constraints.txt ./clients/python ".[otel]"

# gsplat's kernels must be compiled by the CUDA version that torch in constraints.txt was built with: 13.0.
FROM nvidia/cuda:13.0.1-devel-ubuntu24.04 AS build-cuda
# hadolint ignore=DL3008
RUN apt-get update && apt-get install --no-install-recommends --yes python3 python3-venv python3-dev \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /source
RUN python3 -m venv /opt/fvs
COPY constraints.txt pyproject.toml README.md LICENSE ./
COPY fvs_engine fvs_engine
COPY services services
COPY clients/python clients/python
# gsplat compiles its kernels at their first use, so the compiler stays in the image.
RUN /opt/fvs/bin/pip install --no-cache-dir --constraint constraints.txt ./clients/python ".[cuda,otel]"

FROM build-cuda AS cuda
# hadolint ignore=DL3008
RUN apt-get update && apt-get install --no-install-recommends --yes libgomp1 libgl1 libglib2.0-0 \
    && rm -rf /var/lib/apt/lists/* \
    && useradd --uid 10001 --no-create-home --home-dir /var/lib/fvs fvs \
    && install --directory --owner=fvs --group=fvs /var/lib/fvs
ENV PATH=/opt/fvs/bin:$PATH HOME=/var/lib/fvs FVS_ROOT=/var/lib/fvs NUMBA_CACHE_DIR=/var/lib/fvs/cache \
    TORCH_EXTENSIONS_DIR=/var/lib/fvs/cache MPLCONFIGDIR=/tmp
WORKDIR /var/lib/fvs
VOLUME /var/lib/fvs
USER 10001
EXPOSE 8000 8001
ENTRYPOINT ["fvs"]
CMD ["serve", "--log-json"]

FROM python:3.11-slim-bookworm AS cpu
# hadolint ignore=DL3008
RUN apt-get update && apt-get install --no-install-recommends --yes libgomp1 libgl1 libglib2.0-0 \
    && rm -rf /var/lib/apt/lists/* \
    && useradd --uid 10001 --no-create-home --home-dir /var/lib/fvs fvs \
    && install --directory --owner=fvs --group=fvs /var/lib/fvs
COPY --from=build-cpu /opt/fvs /opt/fvs
ENV PATH=/opt/fvs/bin:$PATH HOME=/var/lib/fvs FVS_ROOT=/var/lib/fvs NUMBA_CACHE_DIR=/var/lib/fvs/cache \
    MPLCONFIGDIR=/tmp
WORKDIR /var/lib/fvs
VOLUME /var/lib/fvs
USER 10001
EXPOSE 8000 8001
ENTRYPOINT ["fvs"]
CMD ["serve", "--log-json"]
