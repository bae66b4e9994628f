// Drives both nodes as a tree would: a goal with its lease, the end of the stair, the map and the pose of the floor behind it.
#include <cassert>
#include <iostream>

#include "treadline_nav2/change_floor.hpp"
#include "treadline_nav2/traverse_stair.hpp"

void register_nodes(BT::BehaviorTreeFactory & factory);

template<class M> std::vector<M> published(rclcpp::Node & node, const std::string & topic)
{
  return std::static_pointer_cast<rclcpp::Publisher<M>>(node.publishers.at(topic))->published;
}

int main()
{
  BT::BehaviorTreeFactory factory;
  register_nodes(factory);
  BT::NodeConfiguration configuration{std::make_shared<BT::Blackboard>()};
  auto & board = *configuration.blackboard;
  board = {{"stair_id", std::string("east")}, {"direction", std::string("up")}, {"steps", uint32_t(12)}, {"map_url", std::string("1.yaml")}};

  auto stair_node = factory.builders.at("TraverseStair")("stair", configuration);
  auto & stair = dynamic_cast<treadline_nav2::TraverseStair &>(*stair_node);
  stair.on_tick();
  assert(stair.goal_.stair_id == "east" && stair.goal_.direction == 1 && stair.goal_.steps == 12);
  assert(stair.goal_.lease_s > 0.0 && stair.goal_.lease_s < 1.0 && stair.goal_.foot.header.frame_id.empty());
  stair.on_wait_for_result(nullptr);
  stair.on_wait_for_result(nullptr);
  const auto leases = published<unique_identifier_msgs::msg::UUID>(*stair.node_, "traverse_stair/lease");
  assert(leases.size() == 2 && leases[0].uuid == stair.goal_handle_->get_goal_id());
  stair.result_.result->pose.pose.covariance[0] = 0.04;
  assert(stair.on_cancelled() == BT::NodeStatus::FAILURE && stair.on_aborted() == BT::NodeStatus::FAILURE);
  assert(stair.on_success() == BT::NodeStatus::SUCCESS);

  auto floor_node = factory.builders.at("ChangeFloor")("floor", configuration);
  auto & floor = dynamic_cast<treadline_nav2::ChangeFloor &>(*floor_node);
  floor.on_tick();
  assert(floor.request_->map_url == "1.yaml");
  auto response = std::make_shared<nav2_msgs::srv::LoadMap::Response>();
  assert(floor.on_completion(response) == BT::NodeStatus::FAILURE);  // no pose on the new map
  geometry_msgs::msg::PoseStamped landing{{"map", {}}, {3.5}};
  board["pose"] = landing;
  response->result = 1;
  assert(floor.on_completion(response) == BT::NodeStatus::FAILURE);
  assert(published<geometry_msgs::msg::PoseWithCovarianceStamped>(*floor.node_, "initialpose").empty());
  response->result = 0;
  assert(floor.on_completion(response) == BT::NodeStatus::SUCCESS);
  const auto poses = published<geometry_msgs::msg::PoseWithCovarianceStamped>(*floor.node_, "initialpose");
  assert(poses.size() == 1 && poses[0].header.frame_id == "map" && poses[0].pose.pose.x == 3.5 && poses[0].pose.covariance[0] == 0.04);
  for (const auto & [name, ports] : factory.ports) {
    for (const auto & port : ports) {std::cout << name << " " << port.first << "\n";}
  }
}
