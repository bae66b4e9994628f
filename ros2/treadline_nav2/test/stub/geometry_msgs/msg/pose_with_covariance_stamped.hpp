// Stub of the generated message for the test.
#pragma once
#include "geometry_msgs/msg/pose_stamped.hpp"
