# treadline with Gazebo 11 and the tracked-vehicle plugin, for machines where legacy/gazebo/environment.sh has no root or no chroot:
#   docker build -t treadline . && docker run --rm -v "$PWD/out:/out" treadline reproduce --plant gazebo --out /out
# Ubuntu 22.04, supported until April 2027, is the last system with packages of Gazebo 11. Its own Python is 3.10: uv installs another.
FROM ubuntu:22.04

RUN apt-get update \
    && DEBIAN_FRONTEND=noninteractive apt-get install --yes --no-install-recommends \
        gazebo gazebo-common gazebo-plugin-base libgazebo-dev xvfb libgl1-mesa-dri g++ make cmake ca-certificates python3-pip \
    && apt-get clean && rm -rf /var/lib/apt/lists/*

ENV TREADLINE_GAZEBO=/

# The plugin alone first: it changes less often than the rest. A build that fails takes its log with it, so it is shown.
COPY legacy/gazebo /opt/treadline-source/legacy/gazebo
RUN mkdir /opt/log && TMPDIR=/opt/log /opt/treadline-source/legacy/gazebo/environment.sh || { cat /opt/log/* >&2; exit 1; }

# Every package by the hashes of its lock file.
ENV UV_PYTHON_INSTALL_DIR=/opt/python UV_NO_CACHE=1 VIRTUAL_ENV=/opt/treadline PATH=/opt/treadline/bin:$PATH
COPY requirements /opt/treadline-source/requirements
RUN python3 -m pip install --no-cache-dir --require-hashes -r /opt/treadline-source/requirements/uv.lock \
    && uv venv --python 3.12 /opt/treadline \
    && uv pip install --require-hashes -r /opt/treadline-source/requirements/base.lock

COPY pyproject.toml README.md LICENSE /opt/treadline-source/
COPY src /opt/treadline-source/src
RUN uv pip install --no-deps --no-build-isolation /opt/treadline-source

# Any user may run it (docker run --user): what is compiled on first use needs a home that everybody can write to.
ENV HOME=/tmp

ENTRYPOINT ["treadline"]
