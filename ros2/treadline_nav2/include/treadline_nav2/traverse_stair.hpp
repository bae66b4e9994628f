// A node of Nav2's behaviour trees: traverses a stair by the action traverse_stair, and renews its lease at each tick.
#pragma once

#include <memory>
#include <string>

#include "geometry_msgs/msg/pose_stamped.hpp"
#include "geometry_msgs/msg/pose_with_covariance_stamped.hpp"
#include "nav2_behavior_tree/bt_action_node.hpp"
#include "rclcpp/rclcpp.hpp"
#include "treadline_msgs/action/traverse_stair.hpp"
#include "unique_identifier_msgs/msg/uuid.hpp"

namespace treadline_nav2
{

/// Succeeds where the chair arrives; verdict, cause and the pose at the end are outputs. Where the tree is halted, or its process
/// dies, the chair is held: the goal has a lease.
class TraverseStair : public nav2_behavior_tree::BtActionNode<treadline_msgs::action::TraverseStair>
{
public:
  using Action = treadline_msgs::action::TraverseStair;

  TraverseStair(const std::string & tag, const std::string & action, const BT::NodeConfiguration & configuration);

  void on_tick() override;
  void on_wait_for_result(std::shared_ptr<const Action::Feedback> feedback) override;
  BT::NodeStatus on_success() override;
  BT::NodeStatus on_aborted() override;
  BT::NodeStatus on_cancelled() override;

  static BT::PortsList providedPorts();

private:
  BT::NodeStatus report(BT::NodeStatus status);

  rclcpp::Publisher<unique_identifier_msgs::msg::UUID>::SharedPtr lease_;
};

}  // namespace treadline_nav2
