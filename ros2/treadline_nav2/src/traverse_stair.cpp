#include "treadline_nav2/traverse_stair.hpp"

#include <string>

namespace treadline_nav2
{
namespace
{
constexpr double kLeaseS = 0.6;  // sixty ticks of bt_navigator's default loop of 10 ms; with the ramp of the belts below 1 s
}

TraverseStair::TraverseStair(const std::string & tag, const std::string & action, const BT::NodeConfiguration & configuration)
: BtActionNode<Action>(tag, action, configuration)
{
  lease_ = node_->create_publisher<unique_identifier_msgs::msg::UUID>("traverse_stair/lease", 1);
}

void TraverseStair::on_tick()
{
  goal_ = Action::Goal();
  std::string direction;
  getInput("stair_id", goal_.stair_id);
  getInput("direction", direction);
  getInput("foot", goal_.foot);
  getInput("steps", goal_.steps);
  getInput("step_rise_m", goal_.step_rise_m);
  getInput("speed_m_s", goal_.speed_m_s);
  getInput("time_limit_s", goal_.time_limit_s);
  goal_.lease_s = kLeaseS;
  goal_.direction = direction == "up" ? Action::Goal::DIRECTION_UP :
    direction == "down" ? Action::Goal::DIRECTION_DOWN : Action::Goal::DIRECTION_OF_SCENARIO;
}

void TraverseStair::on_wait_for_result(std::shared_ptr<const Action::Feedback>)
{
  unique_identifier_msgs::msg::UUID id;
  id.uuid = goal_handle_->get_goal_id();
  lease_->publish(id);
}

BT::NodeStatus TraverseStair::on_success()
{
  return report(BT::NodeStatus::SUCCESS);
}

BT::NodeStatus TraverseStair::on_aborted()
{
  return report(BT::NodeStatus::FAILURE);
}

BT::NodeStatus TraverseStair::on_cancelled()
{
  return report(BT::NodeStatus::FAILURE);
}

BT::NodeStatus TraverseStair::report(BT::NodeStatus status)
{
  setOutput("verdict", static_cast<int>(result_.result->verdict));
  setOutput("cause", result_.result->cause);
  setOutput("end", result_.result->pose);
  return status;
}

BT::PortsList TraverseStair::providedPorts()
{
  return providedBasicPorts({
    BT::InputPort<std::string>("stair_id", "", "name of the stair"),
    BT::InputPort<std::string>("direction", "", "up or down; empty: that of the graph"),
    BT::InputPort<geometry_msgs::msg::PoseStamped>("foot", "where the flight begins, in odom or base_link; may be left out"),
    BT::InputPort<uint32_t>("steps", 0u, "expected number of steps; 0: not compared"),
    BT::InputPort<double>("step_rise_m", 0.0, "expected rise of a step [m]; 0: not compared"),
    BT::InputPort<double>("speed_m_s", 0.0, "belt speed on the flight [m/s]; 0: that of the graph"),
    BT::InputPort<double>("time_limit_s", 0.0, "time after which the traversal is given up [s]; 0: none"),
    BT::OutputPort<int>("verdict", "TraverseStair.Result.VERDICT_*"),
    BT::OutputPort<std::string>("cause", "the observation behind the verdict"),
    BT::OutputPort<geometry_msgs::msg::PoseWithCovarianceStamped>("end", "pose at the end, in odom"),
  });
}

}  // namespace treadline_nav2
