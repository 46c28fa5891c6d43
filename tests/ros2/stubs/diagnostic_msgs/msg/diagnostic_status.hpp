#pragma once

#include <cstdio>
#include <string>
#include <vector>

#include "diagnostic_msgs/msg/key_value.hpp"

namespace diagnostic_msgs::msg
{
struct DiagnosticStatus
{
  static constexpr unsigned char OK = 0, WARN = 1, ERROR = 2, STALE = 3;
  unsigned char level = 0;
  std::string name, message, hardware_id;
  std::vector<KeyValue> values;
};

// For the test.
inline void print(const std::string & topic, const DiagnosticStatus & status)
{
  std::fprintf(stderr, "%s: %d %s:", topic.c_str(), status.level, status.message.c_str());
  for (const auto & entry : status.values) {
    std::fprintf(stderr, " %s=%s", entry.key.c_str(), entry.value.c_str());
  }
  std::fputc('\n', stderr);
}
}  // namespace diagnostic_msgs::msg
