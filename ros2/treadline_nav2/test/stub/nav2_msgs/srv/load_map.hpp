// Stub of the generated service for the test.
#pragma once
#include <cstdint>
#include <string>

namespace nav2_msgs::srv
{
struct LoadMap
{
  struct Request { std::string map_url; };
  struct Response { static constexpr uint8_t RESULT_SUCCESS = 0; uint8_t result = 0; };
};
}  // namespace nav2_msgs::srv
