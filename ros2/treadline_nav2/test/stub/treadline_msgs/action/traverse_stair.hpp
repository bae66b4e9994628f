// Stub of the generated action for the test; a test compares its fields with TraverseStair.action.
#pragma once
#include <cstdint>
#include <string>
#include "geometry_msgs/msg/pose_stamped.hpp"

namespace treadline_msgs::action
{
struct TraverseStair
{
  struct Goal
  {
    static constexpr uint8_t DIRECTION_OF_SCENARIO = 0, DIRECTION_UP = 1, DIRECTION_DOWN = 2;
    std::string stair_id;
    uint8_t direction = 0;
    geometry_msgs::msg::PoseStamped foot;
    uint32_t steps = 0;
    double step_rise_m = 0.0;
    double speed_m_s = 0.0;
    double time_limit_s = 0.0;
    double lease_s = 0.0;
  };
  struct Result
  {
    uint8_t verdict = 0;
    std::string cause;
    geometry_msgs::msg::PoseWithCovarianceStamped pose;
  };
  struct Feedback {};
};
}  // namespace treadline_msgs::action
