// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/notices.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>

namespace trocar::runtime {
namespace {

constexpr std::chrono::milliseconds kPollInterval{5};
static_assert(kFaults < 64, "RecoveryWatch has a bit for each fault and one more");

std::string seconds(double t_s) {
  char text[40];
  std::snprintf(text, sizeof text, "%.4f s", t_s);
  return text;
}

std::string reason(const Notice& notice) {
  if (notice.detail.fault == Fault::kNone) {
    // Rounded up: lifting by this is enough.
    const auto up_mm = static_cast<long long>(std::ceil(notice.lift_m * 1e3 - 1e-6));
    return "the tool is in material: lift it " + std::to_string(std::max(1LL, up_mm)) + " mm";
  }
  const FaultWords& words = words_of(notice.detail.fault);
  const std::string found = measured(notice.detail);
  return std::string(words.still) + (found.empty() ? "" : " (" + found + ")") + "; " + words.advice;
}

}  // namespace

std::string describe(const Notice& notice) {
  switch (notice.kind) {
    case Notice::Kind::kFault:
      return "fault " + trocar::describe(notice.detail, notice.t_s);
    case Notice::Kind::kNotRecovered:
      return "no recovery yet at " + seconds(notice.t_s) + ": " + reason(notice);
    case Notice::Kind::kRecovered:
      return "recovered at " + seconds(notice.t_s) + " from the fault " +
             to_string(notice.detail.fault) + ": forces rise again";
  }
  return {};
}

void Notices::start() {
  stopping_.store(false);
  thread_ = std::thread([this] {
    while (!stopping_.load(std::memory_order_acquire)) {
      serve();
      std::this_thread::sleep_for(kPollInterval);
    }
  });
}

void Notices::serve() {
  Notice notice;
  while (waiting_.pop(notice))
    tell_(notice);
}

void Notices::stop() {
  if (thread_.joinable()) {
    stopping_.store(true, std::memory_order_release);
    thread_.join();
  }
  serve();
}

bool RecoveryWatch::tells(bool waiting, double t_s, const FaultDetail& found,
                          double lift_m) noexcept {
  if (!waiting) {
    asked_t_s_ = -1;
    return false;
  }
  if (asked_t_s_ < 0) asked_t_s_ = t_s;
  if (t_s - asked_t_s_ < kPatience_s) return false;
  if (found.fault == Fault::kNone && !(lift_m > 0)) return false;
  // kNone's bit stands for the tool in material.
  const std::uint64_t bit = std::uint64_t{1} << static_cast<unsigned>(found.fault);
  if ((told_ & bit) != 0) return false;
  told_ |= bit;
  return true;
}

}  // namespace trocar::runtime
