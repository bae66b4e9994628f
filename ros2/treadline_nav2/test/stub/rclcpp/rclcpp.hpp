// Stub of rclcpp for the test: publishers keep what they publish.
#pragma once
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace rclcpp
{
template<class M> struct Publisher
{
  using SharedPtr = std::shared_ptr<Publisher<M>>;
  void publish(const M & message) {published.push_back(message);}
  std::vector<M> published;
};
struct Time { int sec = 7; };
struct Node
{
  template<class M> typename Publisher<M>::SharedPtr create_publisher(const std::string & topic, int)
  {
    auto made = std::make_shared<Publisher<M>>();
    publishers[topic] = made;
    return made;
  }
  Time now() {return Time();}
  std::map<std::string, std::shared_ptr<void>> publishers;
};
}  // namespace rclcpp
