#!/bin/sh
# Builds the environment that Gazebo 11 lives in (Debian bullseye in a folder) and compiles the plugin in it; the second call takes
# no time. Prints the environment's root folder, everything else goes to a log. Needs root, chroot and 3 GB, and asks first, unless CI=true. Exit code 77: not here.
#   TREADLINE_GAZEBO   where to build it; ~/.cache/treadline/gazebo otherwise; / compiles the plugin for the Gazebo of this system
#   TREADLINE_MIRROR   a Debian mirror; the one that apt uses otherwise
set -eu

here=$(cd "$(dirname "$0")" && pwd)
cache=${TREADLINE_GAZEBO:-$HOME/.cache/treadline/gazebo}
root=$cache/root
log=$cache/log.txt

fail() {
    echo "treadline: $1" >&2
    exit "${2:-2}"
}

mirror() {
    if [ -n "${TREADLINE_MIRROR:-}" ]; then
        echo "$TREADLINE_MIRROR"
        return
    fi
    apt-get indextargets --format '$(ORIGIN) $(LABEL) $(REPO_URI)' 'Created-By: Packages' 2>/dev/null |
        awk '$1 == "Debian" && $2 == "Debian" { print $3; exit }'
}

build() {
    partial=$cache/partial
    from=$(mirror)
    [ -n "$from" ] || fail "apt knows no Debian mirror here; name one: TREADLINE_MIRROR=http://HOST/debian"
    "$here/../../tools/confirm.sh" "as root, apt-get installs debootstrap where it is missing, and debootstrap and apt-get install \
Debian bullseye with Gazebo 11 in $root (3 GB)" || exit 2
    if ! command -v debootstrap >/dev/null; then
        echo "treadline: installs debootstrap" >&2
        { apt-get update && apt-get install --yes --no-install-recommends debootstrap; } >>"$log" 2>&1 ||
            fail "debootstrap cannot be installed; see $log"
    fi
    echo "treadline: builds the Gazebo 11 environment in $root (about 5 minutes, once)" >&2
    rm -rf "$partial"
    debootstrap --variant=minbase --include=ca-certificates bullseye "$partial" "$from" >>"$log" 2>&1 ||
        fail "debootstrap failed; see $log"
    # Nothing that is installed starts a service, asks a question or stays as an archive.
    printf '#!/bin/sh\nexit 101\n' >"$partial/usr/sbin/policy-rc.d"
    chmod +x "$partial/usr/sbin/policy-rc.d"
    chroot "$partial" env DEBIAN_FRONTEND=noninteractive sh -c 'apt-get update && apt-get install --yes --no-install-recommends \
        gazebo gazebo-common gazebo-plugin-base libgazebo-dev xvfb libgl1-mesa-dri g++ make cmake && apt-get clean' >>"$log" 2>&1 ||
        fail "Gazebo cannot be installed in the environment; see $log"
    mv "$partial" "$root"
}

compile() {
    echo "treadline: compiles the plugin" >&2
    built=$root/opt/treadline
    rm -rf "$built"
    mkdir -p "$built/source"
    cp "$here/CMakeLists.txt" "$here"/*.cc "$built/source/"
    inside sh -c 'cmake -S /opt/treadline/source -B /opt/treadline/build -DCMAKE_BUILD_TYPE=Release && make -C /opt/treadline/build' \
        >>"$log" 2>&1 || fail "the plugin does not compile; see $log"
    sources >"$built/built-from"
}

inside() {
    if [ "$root" = / ]; then "$@"; else chroot "$root" "$@"; fi
}

# What was compiled, for which Gazebo: another of either is compiled anew.
sources() {
    { cat "$here/CMakeLists.txt" "$here"/*.cc; inside dpkg-query --show libgazebo-dev; } | sha256sum | cut -d ' ' -f 1
}

if [ "$cache" = / ]; then
    root=/ log=$(mktemp)
    [ -e /usr/bin/gzserver ] || fail "TREADLINE_GAZEBO is /, and this system has no gzserver"
else
    [ "$(id -u)" = 0 ] || fail "Gazebo's environment needs root; run it as root, or take the Dockerfile" 77
    chroot / true 2>/dev/null || fail "chroot is not allowed here; take the Dockerfile" 77
    mkdir -p "$cache"
    [ -e "$root/usr/bin/gzserver" ] || build
fi
[ "$(cat "$root/opt/treadline/built-from" 2>/dev/null)" = "$(sources)" ] || compile
echo "$root"
