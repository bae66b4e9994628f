// A node of Nav2's behaviour trees: loads the map of the floor behind a stair and sets the pose on it.
#pragma once

#include <memory>
#include <string>

#include "geometry_msgs/msg/pose_stamped.hpp"
#include "geometry_msgs/msg/pose_with_covariance_stamped.hpp"
#include "nav2_behavior_tree/bt_service_node.hpp"
#include "nav2_msgs/srv/load_map.hpp"
#include "rclcpp/rclcpp.hpp"

namespace treadline_nav2
{

/// Succeeds where the map server has the map; the pose is published on initialpose then, with the covariance of the stair's end.
class ChangeFloor : public nav2_behavior_tree::BtServiceNode<nav2_msgs::srv::LoadMap>
{
public:
  using Service = nav2_msgs::srv::LoadMap;

  ChangeFloor(const std::string & tag, const BT::NodeConfiguration & configuration);

  void on_tick() override;
  BT::NodeStatus on_completion(std::shared_ptr<Service::Response> response) override;

  static BT::PortsList providedPorts();

private:
  rclcpp::Publisher<geometry_msgs::msg::PoseWithCovarianceStamped>::SharedPtr pose_;
};

}  // namespace treadline_nav2
