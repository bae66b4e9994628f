// Stub of Nav2's BtActionNode (Jazzy, Kilted) for the test: the members and calls that a child uses.
#pragma once
#include <array>
#include <memory>
#include <string>
#include "behaviortree_cpp/bt_factory.h"
#include "rclcpp/rclcpp.hpp"

namespace nav2_behavior_tree
{
template<class ActionT> class BtActionNode : public BT::TreeNode
{
public:
  BtActionNode(const std::string &, const std::string & action, const BT::NodeConfiguration & configuration)
  : TreeNode(configuration), action_name_(action) {}
  virtual void on_tick() {}
  virtual void on_wait_for_result(std::shared_ptr<const typename ActionT::Feedback>) {}
  virtual BT::NodeStatus on_success() {return BT::NodeStatus::SUCCESS;}
  virtual BT::NodeStatus on_aborted() {return BT::NodeStatus::FAILURE;}
  virtual BT::NodeStatus on_cancelled() {return BT::NodeStatus::SUCCESS;}
  static BT::PortsList providedBasicPorts(BT::PortsList addition) {return addition;}

  struct Handle { std::array<uint8_t, 16> get_goal_id() const {return {1, 2, 3};} };
  struct Wrapped { std::shared_ptr<typename ActionT::Result> result = std::make_shared<typename ActionT::Result>(); };
  std::string action_name_;
  typename ActionT::Goal goal_;
  std::shared_ptr<Handle> goal_handle_ = std::make_shared<Handle>();
  Wrapped result_;
  std::shared_ptr<rclcpp::Node> node_ = std::make_shared<rclcpp::Node>();
};
}  // namespace nav2_behavior_tree
