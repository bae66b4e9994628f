// Stub of the generated message for the test.
#pragma once
#include <array>
#include <string>
#include "rclcpp/rclcpp.hpp"

namespace geometry_msgs::msg
{
struct Pose { double x = 0.0; };
struct Header { std::string frame_id; rclcpp::Time stamp; };
struct PoseStamped { Header header; Pose pose; };
struct PoseWithCovariance { Pose pose; std::array<double, 36> covariance{}; };
struct PoseWithCovarianceStamped { Header header; PoseWithCovariance pose; };
}  // namespace geometry_msgs::msg
