// The controller of the task "@TITLE@" as a plugin of ros2_control, made by taskspec @VERSION@.
//
// All that the task does is in @NAME@.c; here a sample is taken from the state interfaces, and the
// @COMMANDS@ are written to the @INTERFACE@ interfaces. Nothing is allocated and nothing waits in `update`.
#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "controller_interface/controller_interface.hpp"
#include "diagnostic_msgs/msg/diagnostic_status.hpp"
#include "diagnostic_msgs/msg/key_value.hpp"
#include "hardware_interface/types/hardware_interface_type_values.hpp"
#include "pluginlib/class_list_macros.hpp"
#include "rcl_interfaces/msg/floating_point_range.hpp"
#include "rcl_interfaces/msg/parameter_descriptor.hpp"
#include "rclcpp/rclcpp.hpp"

#include "@NAME@.h"
#include "@NAME@_model.h"

namespace @PACKAGE@
{
using controller_interface::CallbackReturn;
using controller_interface::InterfaceConfiguration;
using controller_interface::interface_configuration_type;
using controller_interface::return_type;
using diagnostic_msgs::msg::DiagnosticStatus;

constexpr std::size_t JOINTS = @UPPER@_JOINTS;
constexpr std::size_t REACTIONS = @UPPER@_REACTIONS;
constexpr std::size_t PARAMS = @UPPER@_PARAMS;
constexpr std::size_t VALUES = 2 * JOINTS + 6 + REACTIONS;
// Whether the task takes a reading in the tool's axes, and whether it takes the tool's weight off.
constexpr bool READS_SENSOR = @UPPER@_READS_SENSOR;
constexpr bool WEIGHS = @WEIGHS@;
// What is commanded; torques alone have gravity in them.
constexpr bool TORQUES = @NAME@_quantity == 0, VELOCITIES = @NAME@_quantity == 1;
// Where the task begins [rad or m].
constexpr std::array<double, JOINTS> START @UPPER@_START;
constexpr std::array<const char *, 6> WRENCH{"force.x", "force.y", "force.z",
                                             "torque.x", "torque.y", "torque.z"};
constexpr std::array<const char *, @STATES@> STATES{
  @STATE_LIST@};

class Controller : public controller_interface::ControllerInterface
{
public:
  CallbackReturn on_init() override
  {
    try {
      auto_declare<std::vector<std::string>>("joints", {@JOINT_LIST@});
      auto_declare<std::string>("prefix", "");
      auto_declare<std::string>("sensor", "tcp_fts_sensor");
      auto_declare<std::vector<double>>("sensor_position", {0.0, 0.0, 0.0});
      auto_declare<std::vector<double>>("sensor_rpy", {0.0, 0.0, 0.0});
      auto_declare<bool>("sensor_inverted", false);
      if constexpr (!WEIGHS) auto_declare<bool>("weight_in_reading", false);
      if constexpr (!READS_SENSOR) auto_declare<bool>("wrench_in_world", false);
      if constexpr (REACTIONS > 0) {
        auto_declare<std::vector<std::string>>("reactions", {@REACTION_LIST@});@GRIP_DECLARED@
      }
      if constexpr (TORQUES) auto_declare<bool>("gravity_compensated", false);
      auto_declare<int>("lost_samples", @BEARS@);
      auto_declare<double>("start_tolerance", 0.05);
      declare_params();
    } catch (const std::exception & error) {
      return refused(std::string("a parameter has another type: ") + error.what());
    }
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_configure(const rclcpp_lifecycle::State &) override
  {
    const auto node = get_node();
    const double rate = get_update_rate();
    if (!(std::abs(rate * @UPPER@_PERIOD - 1.0) < 1e-6)) {
      return refused(
        "the task is controlled at @RATE@ Hz, and update_rate is " + std::to_string(rate) +
        "; set update_rate: @RATE@ of the controller_manager, or of this controller");
    }
    const auto joints = node->get_parameter("joints").as_string_array();
    const auto prefix = node->get_parameter("prefix").as_string();
    const auto sensor = node->get_parameter("sensor").as_string();
    const auto position = node->get_parameter("sensor_position").as_double_array();
    const auto rpy = node->get_parameter("sensor_rpy").as_double_array();
    const auto lost = node->get_parameter("lost_samples").as_int();
    std::vector<std::string> reactions;
    if constexpr (REACTIONS > 0) reactions = node->get_parameter("reactions").as_string_array();
    if (joints.size() != JOINTS) {
      return refused(
        "joints has " + std::to_string(joints.size()) + " names; the task has @JOINTS@ joints");
    }
    if (sensor.empty()) return refused("sensor has no name; the task measures the contact force");
    if (position.size() != 3 || rpy.size() != 3) {
      return refused("sensor_position and sensor_rpy have three numbers each");
    }
    if (reactions.size() != REACTIONS) {
      return refused("reactions has one interface for each of these: @REACTION_NAMES@");
    }
    if (lost < 0 || lost > 1000000) return refused("lost_samples is 0 or more");

    commands_.clear();
    states_.clear();
    for (const auto & joint : joints) {
      commands_.push_back(prefix + joint + "/" + hardware_interface::HW_IF_@HARDWARE@);
    }@GRIP_CLAIMED@
    for (const char * kind :
         {hardware_interface::HW_IF_POSITION, hardware_interface::HW_IF_VELOCITY}) {
      for (const auto & joint : joints) states_.push_back(prefix + joint + "/" + kind);
    }
    for (const char * axis : WRENCH) states_.push_back(prefix + sensor + "/" + axis);
    for (const auto & reaction : reactions) states_.push_back(prefix + reaction);

    place_sensor(position, rpy);
    sign_ = node->get_parameter("sensor_inverted").as_bool() ? -1.0 : 1.0;
    weighs_ = !WEIGHS && node->get_parameter("weight_in_reading").as_bool();
    in_world_ = !READS_SENSOR && node->get_parameter("wrench_in_world").as_bool();
    if (in_world_ && weighs_) {
      return refused("a wrench in world axes is of the contact alone: weight_in_reading is false");
    }
    if constexpr (TORQUES) compensated_ = node->get_parameter("gravity_compensated").as_bool();
    lost_ = static_cast<std::int32_t>(lost);
    start_tolerance_ = node->get_parameter("start_tolerance").as_double();

    memory_.assign(@NAME@_size() / sizeof(double) + 1, 0.0);
    publisher_ = node->create_publisher<DiagnosticStatus>(
      "~/status", rclcpp::QoS(rclcpp::KeepLast(1)).transient_local());
    timer_ = node->create_wall_timer(std::chrono::milliseconds(20), [this] { publish(); });
    return CallbackReturn::SUCCESS;
  }

  InterfaceConfiguration command_interface_configuration() const override
  {
    return {interface_configuration_type::INDIVIDUAL, commands_};
  }

  InterfaceConfiguration state_interface_configuration() const override
  {
    return {interface_configuration_type::INDIVIDUAL, states_};
  }

  CallbackReturn on_activate(const rclcpp_lifecycle::State &) override
  {
    if (!ordered(command_interfaces_, commands_) || !ordered(state_interfaces_, states_)) {
      return refused("the interfaces that were assigned are not those of the configuration");
    }
    if (!read()) return refused("a state interface cannot be read");
    if (!std::all_of(values_.begin(), values_.end(), [](double x) { return std::isfinite(x); })) {
      return refused("a state interface has no number yet: is the hardware active?");
    }
    for (std::size_t i = 0; i < JOINTS; ++i) {
      const double off = std::abs(values_[i] - START[i]);
      if (start_tolerance_ > 0.0 && off > start_tolerance_) {
        return refused(
          states_[i] + " is " + std::to_string(values_[i]) + ", and the task begins at " +
          std::to_string(START[i]) + ", further away than start_tolerance; move the arm there");
      }
    }
    task_ = @NAME@_init(memory_.data());
    @NAME@_bear(task_, lost_);
    // The task begins with what they are set to by now.
    set_params();
    started_ = false;
    unread_ = unwritten_ = 0;
    const std::lock_guard<std::mutex> lock(mutex_);
    status_ = @NAME@_status(task_);
    active_ = true;
    return CallbackReturn::SUCCESS;
  }

  return_type update(const rclcpp::Time & time, const rclcpp::Duration &) override
  {
    const bool fresh = read();
    unread_ = fresh ? 0 : unread_ + 1;
    if (!fresh && (!started_ || unread_ <= lost_ + 1)) {
      // A lost sample: the @COMMANDS@ go on, and the task takes it into account at the next one.
      return return_type::OK;
    }
    if (!started_) begin_ = time.nanoseconds();
    input_.stamp = 1e-9 * static_cast<double>(time.nanoseconds() - begin_);
    measure();
    if (!started_) {
      @NAME@_start(task_, &input_, &output_);
      // Nothing is known yet of where the arm is.
      if (output_.state == @UPPER@_BAD_SAMPLE) return return_type::ERROR;
      started_ = true;
    }
    set_params();
    @NAME@_step(task_, &input_, &output_);
    for (std::size_t i = 0; i < JOINTS; ++i) {
      commands_now_[i] = output_.@COMMAND@[i];
      if (compensated_) commands_now_[i] -= gravity_[i];
    }
    unwritten_ = write() ? 0 : unwritten_ + 1;
    const std::unique_lock<std::mutex> lock(mutex_, std::try_to_lock);
    if (lock) status_ = @NAME@_status(task_);
    // The task goes on to answer after its end: the arm comes to rest and stays there.
    return unwritten_ > lost_ ? return_type::ERROR : return_type::OK;
  }

  CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) override
  {
    // What stays in the interfaces leaves the arm where it is, pushes nowhere, and holds on.
    if (started_) {
      if constexpr (TORQUES) commands_now_ = gravity_;
      if (VELOCITIES || compensated_) commands_now_.fill(0.0);
      if (!write()) RCLCPP_WARN(get_node()->get_logger(), "the last @COMMANDS@ were not all written");
    }
    started_ = false;
    const std::lock_guard<std::mutex> lock(mutex_);
    active_ = false;
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_cleanup(const rclcpp_lifecycle::State &) override
  {
    if (timer_) timer_->cancel();
    const std::lock_guard<std::mutex> lock(mutex_);
    timer_.reset();
    publisher_.reset();
    return CallbackReturn::SUCCESS;
  }

private:
  CallbackReturn refused(const std::string & why) const
  {
    RCLCPP_ERROR(get_node()->get_logger(), "%s", why.c_str());
    return CallbackReturn::ERROR;
  }

  // Declares the params that may be set while the task runs. The node refuses values beyond their
  // range; it takes the others in its own threads, and `update` has the newest.
  void declare_params()
  {
    if constexpr (PARAMS > 0) {
      const auto node = get_node();
      for (std::size_t i = 0; i < PARAMS; ++i) {
        const auto & facts = @NAME@_params()[i];
        rcl_interfaces::msg::FloatingPointRange range;
        range.from_value = facts.low;
        range.to_value = facts.high;
        rcl_interfaces::msg::ParameterDescriptor about;
        about.description = std::string("param of the task, unit: ") + facts.unit;
        about.floating_point_range.push_back(range);
        const auto name = std::string("param.") + facts.name;
        wanted_[i] = node->declare_parameter(name, facts.value, about);
      }
      kept_ = node->add_post_set_parameters_callback(
        [this](const std::vector<rclcpp::Parameter> & changed) {
          for (const auto & parameter : changed) {
            for (std::size_t i = 0; i < PARAMS; ++i) {
              if (parameter.get_name() == std::string("param.") + @NAME@_params()[i].name) {
                wanted_[i] = parameter.as_double();
              }
            }
          }
        });
    }
  }

  // Has the task's params go to what they are set to; setting one again changes nothing.
  void set_params()
  {
    for (std::size_t i = 0; i < PARAMS; ++i) {
      @NAME@_set(task_, static_cast<std::int32_t>(i), wanted_[i].load(std::memory_order_relaxed));
    }
  }

  // Whether interfaces are those that were named, in this order.
  template <typename Interfaces>
  static bool ordered(const Interfaces & interfaces, const std::vector<std::string> & names)
  {
    return std::equal(
      interfaces.begin(), interfaces.end(), names.begin(), names.end(),
      [](const auto & interface, const std::string & name) {return interface.get_name() == name;});
  }

  // The sensor's axes and origin in those of the tip.
  void place_sensor(const std::vector<double> & position, const std::vector<double> & rpy)
  {
    const double cr = std::cos(rpy[0]), sr = std::sin(rpy[0]), cp = std::cos(rpy[1]);
    const double sp = std::sin(rpy[1]), cy = std::cos(rpy[2]), sy = std::sin(rpy[2]);
    turn_ = {cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr,
             sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr,
             -sp, cp * sr, cp * cr};
    std::copy(position.begin(), position.end(), lever_.begin());
  }

  // Reads all state interfaces; false where one of them could not be read.
  bool read()
  {
    for (std::size_t i = 0; i < VALUES; ++i) {
      const std::optional<double> value = state_interfaces_[i].get_optional();
      if (!value) return false;
      taken_[i] = *value;
    }
    values_ = taken_;
    return true;
  }

  // Makes a sample of the task of what was read.
  void measure()
  {
    const double * value = values_.data();
    std::copy_n(value, JOINTS, input_.q);
    std::copy_n(value + JOINTS, JOINTS, input_.v);
    @NAME@_model(input_.q, axes_.data(), gravity_.data(), weight_.data());
    const double * read = value + 2 * JOINTS;
    if (in_world_) {
      for (std::size_t i = 0; i < 6; ++i) input_.wrench[i] = sign_ * read[i];
    } else {
      // In the tip's axes, about the tip.
      std::array<double, 6> own{};
      for (std::size_t i = 0; i < 3; ++i) {
        for (std::size_t j = 0; j < 3; ++j) {
          own[i] += sign_ * turn_[3 * i + j] * read[j];
          own[3 + i] += sign_ * turn_[3 * i + j] * read[3 + j];
        }
      }
      for (std::size_t i = 0; i < 3; ++i) {
        const std::size_t j = (i + 1) % 3, k = (i + 2) % 3;
        own[3 + i] += lever_[j] * own[k] - lever_[k] * own[j];
      }
      if (weighs_) {
        for (std::size_t i = 0; i < 6; ++i) own[i] -= weight_[i];
      }
      for (std::size_t i = 0; i < 3; ++i) {
        for (std::size_t half : {std::size_t{0}, std::size_t{3}}) {
          input_.wrench[half + i] = READS_SENSOR
            ? own[half + i]
            : axes_[i] * own[half] + axes_[3 + i] * own[half + 1] + axes_[6 + i] * own[half + 2];
        }
      }
    }
    std::copy_n(read + 6, REACTIONS, input_.reactions);
  }

  // Writes the @COMMANDS@; false where one of them was not taken.
  bool write()
  {
    bool written = true;
    for (std::size_t i = 0; i < JOINTS; ++i) {
      written = command_interfaces_[i].set_value(commands_now_[i]) && written;
    }@GRIP_WRITTEN@
    return written;
  }

  // Publishes where the task is; runs in the node's executor, not in the control loop.
  void publish()
  {
    rclcpp::Publisher<DiagnosticStatus>::SharedPtr publisher;
    struct @NAME@_status now;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      if (!active_ || !publisher_) return;
      publisher = publisher_;
      now = status_;
    }
    const bool fine = now.state == @UPPER@_RUNNING || now.state == @UPPER@_DONE ||
                      now.state == @UPPER@_NOT_STARTED;
    DiagnosticStatus message;
    message.level = fine ? DiagnosticStatus::OK : DiagnosticStatus::ERROR;
    message.name = "@TITLE@";
    message.message = now.text;
    message.hardware_id = @NAME@_task();
    const std::array<std::array<std::string, 2>, 5> facts{{
      {"state", STATES[static_cast<std::size_t>(now.state)]},
      {"stage", now.stage},
      {"event", now.event},
      {"ticks", std::to_string(now.ticks)},
      {"lost", std::to_string(now.lost)}}};
    for (const auto & fact : facts) {
      diagnostic_msgs::msg::KeyValue entry;
      entry.key = fact[0];
      entry.value = fact[1];
      message.values.push_back(entry);
    }
    publisher->publish(message);
    if (now.state != logged_) {
      logged_ = now.state;
      const auto logger = get_node()->get_logger();
      if (fine) {
        RCLCPP_INFO(logger, "%s in stage %s: %s", facts[0][1].c_str(), now.stage, now.text);
      } else {
        RCLCPP_ERROR(logger, "%s in stage %s: %s", facts[0][1].c_str(), now.stage, now.text);
      }
    }
  }

  std::vector<std::string> commands_, states_;
  std::array<double, 9> turn_{}, axes_{};
  std::array<double, 3> lever_{};
  std::array<double, 6> weight_{};
  std::array<double, VALUES> values_{}, taken_{};
  std::array<double, JOINTS> gravity_{}, commands_now_{};
  std::array<std::atomic<double>, PARAMS> wanted_{};
  rclcpp_lifecycle::LifecycleNode::PostSetParametersCallbackHandle::SharedPtr kept_;
  double sign_ = 1.0, start_tolerance_ = 0.0;
  bool weighs_ = false, in_world_ = false, compensated_ = false, started_ = false;
  std::int32_t lost_ = @BEARS@, unread_ = 0, unwritten_ = 0;
  std::int64_t begin_ = 0;
  std::vector<double> memory_;
  struct @NAME@ * task_ = nullptr;
  struct @NAME@_input input_{};
  struct @NAME@_output output_{};

  // Of what is published; the control loop never waits for it.
  std::mutex mutex_;
  struct @NAME@_status status_{};
  std::int32_t logged_ = -1;
  bool active_ = false;
  rclcpp::Publisher<DiagnosticStatus>::SharedPtr publisher_;
  rclcpp::TimerBase::SharedPtr timer_;
};
}  // namespace @PACKAGE@

PLUGINLIB_EXPORT_CLASS(@PACKAGE@::Controller, controller_interface::ControllerInterface)
