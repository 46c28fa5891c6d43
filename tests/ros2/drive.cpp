// Drives a plugin as a controller manager does: configures, activates, updates, deactivates.
//
//   drive LIBRARY RATE [NAME=KIND:VALUE ...] [@ROW:NAME=VALUE ...] < records
//
// What begins with @ sets a parameter of the node before that record. // A parameter's kind is b, i, d, s, or D or S of a list with commas. A record is doubles: what
// happens, the time [ns] and the values of the state interfaces. What happens: 0 nothing; 1 they
// cannot be read; 2 efforts cannot be written. For each record the return of `update` and the
// efforts are written, and at last the efforts after the deactivation.
#include <dlfcn.h>

#include <cstdio>
#include <cstdlib>
#include <limits>
#include <map>
#include <memory>
#include <new>
#include <sstream>
#include <string>
#include <vector>

#include "controller_interface/controller_interface.hpp"

using controller_interface::CallbackReturn;
using hardware_interface::Handle;
using Handles = std::vector<std::shared_ptr<Handle>>;

static bool counting = false;
static long allocations = 0;

void * operator new(std::size_t size)
{
  if (counting) ++allocations;
  void * memory = std::malloc(size);
  if (!memory) throw std::bad_alloc();
  return memory;
}
void operator delete(void * memory) noexcept { std::free(memory); }
void operator delete(void * memory, std::size_t) noexcept { std::free(memory); }

static rclcpp::ParameterVariant parameter(char kind, const std::string & text)
{
  std::vector<std::string> parts;
  std::istringstream stream(text);
  for (std::string part; std::getline(stream, part, ',');) parts.push_back(part);
  switch (kind) {
    case 'b': return text == "true";
    case 'i': return std::int64_t{std::stoll(text)};
    case 'd': return std::stod(text);
    case 'S': return parts;
    case 'D': {
      std::vector<double> numbers;
      for (const auto & part : parts) numbers.push_back(std::stod(part));
      return numbers;
    }
    default: return text;
  }
}

static Handles handles(const controller_interface::InterfaceConfiguration & configuration)
{
  Handles made;
  for (const auto & name : configuration.names) {
    std::fprintf(stderr, "interface: %s\n", name.c_str());
    made.push_back(std::make_shared<Handle>(Handle{name}));
    made.back()->value = std::numeric_limits<double>::quiet_NaN();
  }
  return made;
}

int main(int count, char ** words)
{
  void * library = count > 2 ? dlopen(words[1], RTLD_NOW) : nullptr;
  if (!library) {
    std::fprintf(stderr, "%s\n", dlerror());
    return 2;
  }
  using Make = controller_interface::ControllerInterface * (*)();
  const auto make = reinterpret_cast<Make>(dlsym(library, "make_plugin"));
  std::unique_ptr<controller_interface::ControllerInterface> controller(make());

  std::map<std::string, rclcpp::ParameterVariant> parameters;
  struct Move { std::string name; double value; };
  std::multimap<long, Move> moves;
  for (int i = 3; i < count; ++i) {
    const std::string word = words[i];
    const auto at = word.find('=');
    if (word[0] == '@') {
      const auto colon = word.find(':');
      const std::string name = word.substr(colon + 1, at - colon - 1);
      moves.insert({std::stol(word.substr(1)), {name, std::stod(word.substr(at + 1))}});
      continue;
    }
    parameters[word.substr(0, at)] = parameter(word[at + 1], word.substr(at + 3));
  }
  const rclcpp_lifecycle::State state;
  const auto rate = static_cast<unsigned int>(std::atoi(words[2]));
  if (controller->init(parameters, rate) != CallbackReturn::SUCCESS) return 3;
  if (controller->on_configure(state) != CallbackReturn::SUCCESS) return 3;

  const Handles commands = handles(controller->command_interface_configuration());
  const Handles states = handles(controller->state_interface_configuration());
  std::vector<hardware_interface::LoanedCommandInterface> command_loans;
  std::vector<hardware_interface::LoanedStateInterface> state_loans;
  for (const auto & each : commands) command_loans.emplace_back(each);
  for (const auto & each : states) state_loans.emplace_back(each);
  controller->assign_interfaces(std::move(command_loans), std::move(state_loans));

  std::vector<double> record(2 + states.size()), answer(1 + commands.size());
  const auto answered = [&] {
    for (std::size_t i = 0; i < commands.size(); ++i) answer[1 + i] = commands[i]->value;
    std::fwrite(answer.data(), sizeof(double), answer.size(), stdout);
    std::fflush(stdout);
  };
  const rclcpp::Duration period(0, 1000000000 / rate);
  for (long row = 0; std::fread(record.data(), sizeof(double), record.size(), stdin) == record.size();
       ++row) {
    for (std::size_t i = 0; i < states.size(); ++i) {
      states[i]->value = record[2 + i];
      // One that cannot be read is enough, and not the first.
      states[i]->readable = record[0] != 1.0 || i + 1 != states.size();
    }
    for (const auto & each : commands) each->writable = record[0] != 2.0;
    if (row == 0 && controller->on_activate(state) != CallbackReturn::SUCCESS) return 4;
    const auto [first, last] = moves.equal_range(row);
    for (auto move = first; move != last; ++move) {
      const bool taken =
        controller->get_node()->set_parameter(move->second.name, move->second.value);
      std::fprintf(stderr, "%s: %s\n", move->second.name.c_str(), taken ? "taken" : "refused");
    }
    counting = true;
    const auto done =
      controller->update(rclcpp::Time(static_cast<std::int64_t>(record[1])), period);
    counting = false;
    answer[0] = static_cast<double>(done);
    answered();
    if (row % 20 == 0) {
      for (const auto & timer : controller->get_node()->timers) timer->fire();
    }
  }
  for (const auto & timer : controller->get_node()->timers) timer->fire();
  if (controller->on_deactivate(state) != CallbackReturn::SUCCESS) return 5;
  answer[0] = 0.0;
  answered();
  if (controller->on_cleanup(state) != CallbackReturn::SUCCESS) return 5;
  std::fprintf(stderr, "allocations: %ld\n", allocations);
  return 0;
}
