#include "treadline_nav2/change_floor.hpp"

namespace treadline_nav2
{

ChangeFloor::ChangeFloor(const std::string & tag, const BT::NodeConfiguration & configuration)
: BtServiceNode<Service>(tag, configuration)
{
  pose_ = node_->create_publisher<geometry_msgs::msg::PoseWithCovarianceStamped>("initialpose", 1);
}

void ChangeFloor::on_tick()
{
  getInput("map_url", request_->map_url);
}

BT::NodeStatus ChangeFloor::on_completion(std::shared_ptr<Service::Response> response)
{
  geometry_msgs::msg::PoseStamped landing;
  geometry_msgs::msg::PoseWithCovarianceStamped pose;
  if (response->result != Service::Response::RESULT_SUCCESS || !getInput("pose", landing)) {
    return BT::NodeStatus::FAILURE;
  }
  getInput("end", pose);  // for its covariance
  pose.header = landing.header;
  pose.header.stamp = node_->now();
  pose.pose.pose = landing.pose;
  pose_->publish(pose);
  return BT::NodeStatus::SUCCESS;
}

BT::PortsList ChangeFloor::providedPorts()
{
  return providedBasicPorts({
    BT::InputPort<std::string>("map_url", "map of the floor behind the stair"),
    BT::InputPort<geometry_msgs::msg::PoseStamped>("pose", "where the stair ends, on that map"),
    BT::InputPort<geometry_msgs::msg::PoseWithCovarianceStamped>("end", "pose of TraverseStair, for its covariance"),
  });
}

}  // namespace treadline_nav2
