// The library that bt_navigator loads: plugin_lib_names: [treadline_nav2_bt_nodes].
#include <memory>
#include <string>

#include "behaviortree_cpp/bt_factory.h"
#include "treadline_nav2/change_floor.hpp"
#include "treadline_nav2/traverse_stair.hpp"

BT_REGISTER_NODES(factory)
{
  factory.registerBuilder<treadline_nav2::TraverseStair>(
    "TraverseStair", [](const std::string & name, const BT::NodeConfiguration & configuration) {
      return std::make_unique<treadline_nav2::TraverseStair>(name, "traverse_stair", configuration);
    });
  factory.registerBuilder<treadline_nav2::ChangeFloor>(
    "ChangeFloor", [](const std::string & name, const BT::NodeConfiguration & configuration) {
      return std::make_unique<treadline_nav2::ChangeFloor>(name, configuration);
    });
}
