# The service in a container. `cpu` is one machine's, `ray` (cpu and Ray) and `cuda` (with both) are nodes of a cluster, too.
#
#     docker build --target cpu --tag fvs:cpu .
#     docker build --target ray --tag fvs:ray .
#     docker build --target cuda --tag fvs:cuda .

FROM python:3.11-slim-bookworm AS build-cpu
# hadolint ignore=DL3008
RUN apt-get update && apt-get install --no-install-recommends --yes binutils \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /source
RUN python -m venv --without-pip /opt/fvs
COPY constraints.txt ./
# Extra options of pip. PyPI's torch is the CUDA build, several GB larger: name the index of the CPU builds here.
ARG PIP_OPTIONS=""
# hadolint ignore=SC2086
RUN pip --python /opt/fvs/bin/python install --no-cache-dir $PIP_OPTIONS --constraint constraints.txt torch
COPY pyproject.toml README.md LICENSE ./
COPY fvs_engine fvs_engine
COPY services services
COPY clients/python clients/python
RUN pip --python /opt/fvs/bin/python install --no-cache-dir --constraint constraints.txt ./clients/python ".[otel]"
# What only those need who develop or debug these packages: torch's headers and tests, the tests of others, symbols.
# (strip destroys some of the other libraries, whose layout was changed after they were linked.)
RUN cd /opt/fvs/lib/python3.11/site-packages \
    && rm -rf torch/include torch/test \
    && find torch/bin -type f ! -name torch_shm_manager -delete \
    && find . -type d -name tests -prune -exec rm -r {} + \
    && find torch llvmlite pycolmap fontTools kiwisolver pyproj sqlalchemy -name '*.so' -exec strip --strip-unneeded {} +

FROM python:3.11-slim-bookworm AS build-cuda
# hadolint ignore=DL3008
RUN apt-get update && apt-get install --no-install-recommends --yes binutils g++ \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /source
RUN python -m venv /opt/fvs
COPY constraints.txt ./
RUN /opt/fvs/bin/pip install --no-cache-dir --constraint constraints.txt ninja numpy setuptools torch wheel
# gsplat's kernels are compiled here, by the CUDA version of that torch, which has its libraries. The compiler goes.
ENV CUDA_HOME=/opt/fvs/lib/python3.11/site-packages/nvidia/cu13
ARG CUDA=13.0
# CPU processes that compile at once; each may take 4 GB of memory.
ARG MAX_JOBS=4
RUN /opt/fvs/bin/pip install --no-cache-dir "nvidia-cuda-cccl==$CUDA.*" "nvidia-cuda-crt==$CUDA.*" \
        "nvidia-cuda-nvcc==$CUDA.*" "nvidia-nvvm==$CUDA.*" \
    && ln -s libcudart.so.13 "$CUDA_HOME/lib/libcudart.so" \
    && PATH="/opt/fvs/bin:$PATH" TORCH_CUDA_ARCH_LIST="8.0;8.6;8.9;9.0;10.0;12.0+PTX" \
        /opt/fvs/bin/pip install --no-cache-dir --no-build-isolation --no-deps --no-binary gsplat \
        --constraint constraints.txt gsplat \
    && rm "$CUDA_HOME/lib/libcudart.so" \
    && /opt/fvs/bin/pip uninstall --yes nvidia-cuda-cccl nvidia-cuda-crt nvidia-cuda-nvcc nvidia-nvvm
COPY pyproject.toml README.md LICENSE ./
COPY fvs_engine fvs_engine
COPY services services
COPY clients/python clients/python
# Triton comes with symbols for debuggers, a quarter of a GB, and with static libraries.
RUN /opt/fvs/bin/pip install --no-cache-dir --constraint constraints.txt ./clients/python ".[cuda,otel,ray]" \
    && strip --strip-debug /opt/fvs/lib/python3.11/site-packages/triton/_C/libtriton.so \
    && find /opt/fvs -name '*.a' -delete

FROM python:3.11-slim-bookworm AS service
# hadolint ignore=DL3008
RUN apt-get update && apt-get install --no-install-recommends --yes libgomp1 \
    && rm -rf /var/lib/apt/lists/* \
    && useradd --uid 10001 --no-create-home --home-dir /var/lib/fvs fvs \
    && install --directory --owner=fvs --group=fvs /var/lib/fvs
ENV PATH=/opt/fvs/bin:$PATH HOME=/var/lib/fvs FVS_ROOT=/var/lib/fvs NUMBA_CACHE_DIR=/var/lib/fvs/cache \
    MPLCONFIGDIR=/tmp
WORKDIR /var/lib/fvs
VOLUME /var/lib/fvs
USER 10001
EXPOSE 8000 8001
ENTRYPOINT ["fvs"]
CMD ["serve", "--log-json"]

FROM service AS cuda
# Triton compiles, at the first use of a kernel, what launches it: that takes a C compiler and Python's headers.
USER 0
# hadolint ignore=DL3008
RUN apt-get update && apt-get install --no-install-recommends --yes gcc libc6-dev \
    && rm -rf /var/lib/apt/lists/*
USER 10001
COPY --from=build-cuda /opt/fvs /opt/fvs
ENV NVIDIA_DRIVER_CAPABILITIES=compute,utility TRITON_CACHE_DIR=/var/lib/fvs/cache/triton

FROM service AS cpu
COPY --from=build-cpu /opt/fvs /opt/fvs

FROM cpu AS ray
USER 0
# Without what is for Java and for training by reinforcement.
RUN --mount=type=bind,source=constraints.txt,target=/tmp/constraints.txt \
    pip --python /opt/fvs/bin/python install --no-cache-dir --constraint /tmp/constraints.txt "fvs[ray]" \
    && rm -r /opt/fvs/lib/python3.11/site-packages/ray/jars /opt/fvs/lib/python3.11/site-packages/ray/rllib
# The head starts a program for each client; gRPC's threads would crash it in one of several forks (Ray's issue 63202).
ENV GRPC_ENABLE_FORK_SUPPORT=0
USER 10001
