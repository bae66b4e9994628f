// Stub of behaviortree_cpp for the test: ports on a map, and builders by name.
#pragma once
#include <any>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>

namespace BT
{
enum class NodeStatus { IDLE, RUNNING, SUCCESS, FAILURE };
using Blackboard = std::map<std::string, std::any>;
struct NodeConfiguration { std::shared_ptr<Blackboard> blackboard; };
using PortsList = std::map<std::string, std::string>;
template<class T> std::pair<std::string, std::string> InputPort(const std::string & name, const std::string & help) {return {name, help};}
template<class T, class D> std::pair<std::string, std::string> InputPort(const std::string & name, const D & value, const std::string & help)
{
  static_cast<void>(T(value));
  return {name, help};
}
template<class T> std::pair<std::string, std::string> OutputPort(const std::string & name, const std::string & help) {return {name, help};}

class TreeNode
{
public:
  explicit TreeNode(const NodeConfiguration & configuration) : configuration_(configuration) {}
  virtual ~TreeNode() = default;
  template<class T> bool getInput(const std::string & name, T & value)
  {
    const auto found = configuration_.blackboard->find(name);
    if (found == configuration_.blackboard->end()) {return false;}
    value = std::any_cast<T>(found->second);
    return true;
  }
  template<class T> void setOutput(const std::string & name, const T & value) {(*configuration_.blackboard)[name] = value;}

private:
  NodeConfiguration configuration_;
};

class BehaviorTreeFactory
{
public:
  using Builder = std::function<std::unique_ptr<TreeNode>(const std::string &, const NodeConfiguration &)>;
  template<class T> void registerBuilder(const std::string & name, Builder builder)
  {
    ports[name] = T::providedPorts();
    builders[name] = builder;
  }
  std::map<std::string, Builder> builders;
  std::map<std::string, PortsList> ports;
};
}  // namespace BT

#define BT_REGISTER_NODES(factory) void register_nodes(BT::BehaviorTreeFactory & factory)
