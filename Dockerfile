# treadline with Gazebo 11 and the tracked-vehicle plugin, for machines where legacy/gazebo/environment.sh has no root or no chroot:
#   docker build -t treadline . && docker run --rm -v "$PWD/out:/out" treadline reproduce --plant gazebo --out /out
# bullseye is the last Debian with Gazebo 11.
FROM python:3.11-bullseye

RUN apt-get update \
    && DEBIAN_FRONTEND=noninteractive apt-get install --yes --no-install-recommends \
        gazebo gazebo-common gazebo-plugin-base libgazebo-dev xvfb libgl1-mesa-dri g++ make cmake \
    && apt-get clean && rm -rf /var/lib/apt/lists/*

ENV TREADLINE_GAZEBO=/

# The plugin alone first: it changes less often than the rest. A build that fails takes its log with it, so it is shown.
COPY legacy/gazebo /opt/treadline-source/legacy/gazebo
RUN mkdir /opt/log && TMPDIR=/opt/log /opt/treadline-source/legacy/gazebo/environment.sh || { cat /opt/log/* >&2; exit 1; }

COPY pyproject.toml README.md LICENSE /opt/treadline-source/
COPY src /opt/treadline-source/src
RUN python -m pip install --no-cache-dir "/opt/treadline-source[ros]"

# Any user may run it (docker run --user): what is compiled on first use needs a home that everybody can write to.
ENV HOME=/tmp

ENTRYPOINT ["treadline"]
