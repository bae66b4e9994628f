// Stub of Nav2's BtServiceNode (Jazzy, Kilted) for the test: the members and calls that a child uses.
#pragma once
#include <memory>
#include <string>
#include "behaviortree_cpp/bt_factory.h"
#include "rclcpp/rclcpp.hpp"

namespace nav2_behavior_tree
{
template<class ServiceT> class BtServiceNode : public BT::TreeNode
{
public:
  BtServiceNode(const std::string &, const BT::NodeConfiguration & configuration, const std::string & = "") : TreeNode(configuration) {}
  virtual void on_tick() {}
  virtual BT::NodeStatus on_completion(std::shared_ptr<typename ServiceT::Response>) {return BT::NodeStatus::SUCCESS;}
  static BT::PortsList providedBasicPorts(BT::PortsList addition) {return addition;}

  std::shared_ptr<typename ServiceT::Request> request_ = std::make_shared<typename ServiceT::Request>();
  std::shared_ptr<rclcpp::Node> node_ = std::make_shared<rclcpp::Node>();
};
}  // namespace nav2_behavior_tree
