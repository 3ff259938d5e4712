// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/farm/fault_point.h"

#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <string>

namespace trocar::farm {
namespace {

struct Fault {
  std::string who, where;
  bool stops = false;
};

// Read once, before there are threads.
const Fault& wanted() {
  static const Fault fault = [] {
    const char* const text = std::getenv("TROCAR_BATCH_FAULT");  // NOLINT(concurrency-mt-unsafe)
    Fault out;
    if (text == nullptr) return out;
    const std::string all = text;
    const std::size_t first = all.find(':');
    if (first == std::string::npos) return out;
    const std::size_t second = all.find(':', first + 1);
    out.who = all.substr(0, first);
    out.where = all.substr(first + 1, second == std::string::npos ? second : second - first - 1);
    out.stops = second != std::string::npos && all.substr(second + 1) == "stop";
    return out;
  }();
  return fault;
}

ProcessRole role = ProcessRole::kBatch;
int places = 0;
bool done = false;

}  // namespace

void take_role(ProcessRole now) {
  role = now;
  places = 0;
  done = false;
}

void fault_point(const char* name) {
  const Fault& fault = wanted();
  if (fault.who.empty() || done) return;
  const bool is_mine = role == ProcessRole::kBatch ? fault.who == "batch" : fault.who != "batch";
  ++places;
  if (!is_mine || (fault.where != name && fault.where != std::to_string(places))) return;
  done = true;
  if (fault.stops) {
    ::raise(SIGSTOP);
    return;
  }
  if (fault.who == "both") ::kill(::getppid(), SIGKILL);
  ::raise(SIGKILL);
}

}  // namespace trocar::farm
