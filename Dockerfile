# SPDX-License-Identifier: BSD-3-Clause
# docker build -t dsorb . ; docker run --rm -v "$PWD:/data" dsorb run clip.mp4 --hfov 65 --output out
FROM debian:12 AS build
RUN apt-get update && apt-get install -y --no-install-recommends g++-12 cmake ninja-build ccache make nasm tcl pkg-config dpkg-dev \
    ca-certificates python3-venv && rm -rf /var/lib/apt/lists/*
COPY . /src
RUN cd /src && scripts/wheels/build.sh "$(uname -m)" cp311

FROM debian:12-slim
RUN apt-get update && apt-get install -y --no-install-recommends python3-venv && rm -rf /var/lib/apt/lists/* && python3 -m venv /opt/dsorb
COPY --from=build /src/out/wheels /wheels
RUN /opt/dsorb/bin/pip install --no-cache-dir /wheels/*cp311*.whl
WORKDIR /data
ENTRYPOINT ["/opt/dsorb/bin/dsorb"]
