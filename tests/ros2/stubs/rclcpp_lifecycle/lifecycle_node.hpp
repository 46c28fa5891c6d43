#pragma once

#include <chrono>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "rclcpp/rclcpp.hpp"

namespace rclcpp_lifecycle
{
class State
{
};

template <typename MessageT>
class LifecyclePublisher : public rclcpp::Publisher<MessageT>
{
public:
  using rclcpp::Publisher<MessageT>::Publisher;
};

class LifecycleNode
{
public:
  explicit LifecycleNode(std::map<std::string, rclcpp::ParameterVariant> given)
  : given_(std::move(given))
  {
  }

  rclcpp::Logger get_logger() const { return {}; }
  bool has_parameter(const std::string & name) const { return declared_.count(name) > 0; }

  template <typename T>
  auto declare_parameter(const std::string & name, const T & value)
  {
    rclcpp::ParameterVariant kept;
    if constexpr (std::is_same_v<T, int>) {
      kept = std::int64_t{value};
    } else {
      kept = value;
    }
    const auto found = given_.find(name);
    if (found != given_.end()) {
      if (found->second.index() != kept.index()) {
        throw rclcpp::ParameterTypeException("parameter '" + name + "' has another type");
      }
      kept = found->second;
    }
    declared_.emplace(name, kept);
    return value;
  }

  rclcpp::Parameter get_parameter(const std::string & name) const
  {
    return {name, declared_.at(name)};
  }

  template <typename MessageT>
  std::shared_ptr<LifecyclePublisher<MessageT>> create_publisher(
    const std::string & topic, const rclcpp::QoS &)
  {
    return std::make_shared<LifecyclePublisher<MessageT>>(topic);
  }

  template <typename Rep, typename Period, typename CallbackT>
  std::shared_ptr<rclcpp::TimerBase> create_wall_timer(
    std::chrono::duration<Rep, Period>, CallbackT callback)
  {
    timers.push_back(std::make_shared<rclcpp::TimerBase>(std::move(callback)));
    return timers.back();
  }

  // In the test's hands.
  std::vector<std::shared_ptr<rclcpp::TimerBase>> timers;

private:
  std::map<std::string, rclcpp::ParameterVariant> given_, declared_;
};

namespace node_interfaces
{
class LifecycleNodeInterface
{
public:
  enum class CallbackReturn : std::uint8_t { SUCCESS = 97, FAILURE = 98, ERROR = 99 };
  virtual ~LifecycleNodeInterface() = default;
  virtual CallbackReturn on_configure(const State &) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_cleanup(const State &) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_shutdown(const State &) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_activate(const State &) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_deactivate(const State &) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_error(const State &) { return CallbackReturn::SUCCESS; }
};
}  // namespace node_interfaces
}  // namespace rclcpp_lifecycle
