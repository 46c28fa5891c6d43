#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace rclcpp
{
class Time
{
public:
  explicit Time(std::int64_t nanoseconds) : nanoseconds_(nanoseconds) {}
  std::int64_t nanoseconds() const { return nanoseconds_; }
  double seconds() const { return 1e-9 * static_cast<double>(nanoseconds_); }

private:
  std::int64_t nanoseconds_;
};

class Duration
{
public:
  Duration(std::int32_t seconds, std::uint32_t nanoseconds)
  : nanoseconds_(std::int64_t{seconds} * 1000000000 + nanoseconds)
  {
  }
  std::int64_t nanoseconds() const { return nanoseconds_; }

private:
  std::int64_t nanoseconds_;
};

class Logger
{
};

class ParameterTypeException : public std::runtime_error
{
public:
  using std::runtime_error::runtime_error;
};

using ParameterVariant = std::variant<
  bool, std::int64_t, double, std::string, std::vector<double>, std::vector<std::string>>;

class Parameter
{
public:
  Parameter(std::string name, ParameterVariant value)
  : name_(std::move(name)), value_(std::move(value))
  {
  }
  const std::string & get_name() const { return name_; }
  bool as_bool() const { return as<bool>(); }
  std::int64_t as_int() const { return as<std::int64_t>(); }
  double as_double() const { return as<double>(); }
  const std::string & as_string() const { return as<std::string>(); }
  const std::vector<double> & as_double_array() const { return as<std::vector<double>>(); }
  const std::vector<std::string> & as_string_array() const
  {
    return as<std::vector<std::string>>();
  }
  const ParameterVariant & value() const { return value_; }

private:
  template <typename T>
  const T & as() const
  {
    const T * value = std::get_if<T>(&value_);
    if (!value) throw ParameterTypeException("parameter '" + name_ + "' has another type");
    return *value;
  }

  std::string name_;
  ParameterVariant value_;
};

struct KeepLast
{
  explicit KeepLast(std::size_t depth_) : depth(depth_) {}
  std::size_t depth;
};

class QoS
{
public:
  explicit QoS(const KeepLast & history) : depth_(history.depth) {}
  QoS & transient_local() { return *this; }
  std::size_t depth() const { return depth_; }

private:
  std::size_t depth_;
};

// Has the test print a message: `print` is found by the message's type.
template <typename MessageT>
class Publisher
{
public:
  using SharedPtr = std::shared_ptr<Publisher<MessageT>>;
  explicit Publisher(std::string topic) : topic_(std::move(topic)) {}
  virtual ~Publisher() = default;
  void publish(const MessageT & message) { print(topic_, message); }

private:
  std::string topic_;
};

class TimerBase
{
public:
  using SharedPtr = std::shared_ptr<TimerBase>;
  explicit TimerBase(std::function<void()> callback) : callback_(std::move(callback)) {}
  virtual ~TimerBase() = default;
  void cancel() { callback_ = nullptr; }
  void fire()
  {
    if (callback_) callback_();
  }

private:
  std::function<void()> callback_;
};

[[gnu::format(printf, 3, 4)]] inline void log(
  const Logger &, const char * level, const char * format, ...);
}  // namespace rclcpp

#include <cstdarg>

inline void rclcpp::log(const Logger &, const char * level, const char * format, ...)
{
  std::fprintf(stderr, "%s: ", level);
  va_list arguments;
  va_start(arguments, format);
  std::vfprintf(stderr, format, arguments);
  va_end(arguments);
  std::fputc('\n', stderr);
}

#define RCLCPP_INFO(logger, ...) rclcpp::log(logger, "info", __VA_ARGS__)
#define RCLCPP_WARN(logger, ...) rclcpp::log(logger, "warning", __VA_ARGS__)
#define RCLCPP_ERROR(logger, ...) rclcpp::log(logger, "error", __VA_ARGS__)
