// In the real package: handle.hpp, loaned_state_interface.hpp, loaned_command_interface.hpp.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <utility>

namespace hardware_interface
{
// A number of the hardware, and whether it can be locked at this moment.
struct Handle
{
  std::string name;
  double value = 0.0;
  bool readable = true, writable = true;
};

class LoanedStateInterface
{
public:
  explicit LoanedStateInterface(std::shared_ptr<const Handle> handle) : handle_(std::move(handle)) {}
  LoanedStateInterface(const LoanedStateInterface & other) = delete;
  LoanedStateInterface(LoanedStateInterface && other) = default;
  virtual ~LoanedStateInterface() = default;

  const std::string & get_name() const { return handle_->name; }

  [[deprecated("Use std::optional<T> get_optional() instead to retrieve the value.")]] double
  get_value() const
  {
    return handle_->value;
  }

  template <typename T = double>
  [[nodiscard]] std::optional<T> get_optional(unsigned int max_tries = 10) const
  {
    if (max_tries == 0 || !handle_->readable) return std::nullopt;
    return handle_->value;
  }

private:
  std::shared_ptr<const Handle> handle_;
};

class LoanedCommandInterface
{
public:
  explicit LoanedCommandInterface(std::shared_ptr<Handle> handle) : handle_(std::move(handle)) {}
  LoanedCommandInterface(const LoanedCommandInterface & other) = delete;
  LoanedCommandInterface(LoanedCommandInterface && other) = default;
  virtual ~LoanedCommandInterface() = default;

  const std::string & get_name() const { return handle_->name; }

  template <typename T>
  [[nodiscard]] bool set_value(const T & value, unsigned int max_tries = 10)
  {
    if (max_tries == 0 || !handle_->writable) return false;
    handle_->value = value;
    return true;
  }

private:
  std::shared_ptr<Handle> handle_;
};
}  // namespace hardware_interface
