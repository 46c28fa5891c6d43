#pragma once

#include <string>
#include <vector>

#include "rcl_interfaces/msg/floating_point_range.hpp"

namespace rcl_interfaces::msg
{
struct ParameterDescriptor
{
  std::string name, description;
  bool read_only = false;
  // At most one.
  std::vector<FloatingPointRange> floating_point_range;
};
}  // namespace rcl_interfaces::msg
