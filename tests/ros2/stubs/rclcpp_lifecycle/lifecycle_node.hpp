#pragma once

#include <chrono>
#include <map>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "rcl_interfaces/msg/parameter_descriptor.hpp"
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

  // Gives the value that was given; one beyond its range is refused, as rclcpp does.
  template <typename T>
  T declare_parameter(
    const std::string & name, const T & value, const rcl_interfaces::msg::ParameterDescriptor & about)
  {
    ranges_[name] = about.floating_point_range;
    declare_parameter(name, value);
    const T found = std::get<T>(declared_.at(name));
    if (!within(name, found)) {
      throw std::invalid_argument("parameter '" + name + "' is out of its range");
    }
    return found;
  }

  struct PostSetParametersCallbackHandle
  {
    using SharedPtr = std::shared_ptr<PostSetParametersCallbackHandle>;
    std::function<void(const std::vector<rclcpp::Parameter> &)> callback;
  };

  PostSetParametersCallbackHandle::SharedPtr add_post_set_parameters_callback(
    std::function<void(const std::vector<rclcpp::Parameter> &)> callback)
  {
    auto made = std::make_shared<PostSetParametersCallbackHandle>();
    made->callback = std::move(callback);
    post_set_ = made;
    return made;
  }

  // Whether the value is taken; in the test's hands.
  bool set_parameter(const std::string & name, double value)
  {
    if (!within(name, value)) return false;
    declared_.at(name) = value;
    const auto kept = post_set_.lock();
    if (kept) kept->callback({rclcpp::Parameter(name, value)});
    return true;
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
  bool within(const std::string & name, double value) const
  {
    for (const auto & range : ranges_.at(name)) {
      if (!(value >= range.from_value && value <= range.to_value)) return false;
    }
    return true;
  }

  std::map<std::string, rclcpp::ParameterVariant> given_, declared_;
  std::map<std::string, std::vector<rcl_interfaces::msg::FloatingPointRange>> ranges_;
  std::weak_ptr<PostSetParametersCallbackHandle> post_set_;
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
