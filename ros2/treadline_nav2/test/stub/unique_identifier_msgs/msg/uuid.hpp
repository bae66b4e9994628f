// Stub of the generated message for the test.
#pragma once
#include <array>
#include <cstdint>

namespace unique_identifier_msgs::msg
{
struct UUID { std::array<uint8_t, 16> uuid{}; };
}  // namespace unique_identifier_msgs::msg
