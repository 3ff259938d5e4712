// SPDX-License-Identifier: GPL-3.0-or-later
// A message of the Haply Inverse service, given to both readers. Accepted states are finite, and reasons are one short line.
#include <cmath>
#include <string_view>

#include "runtime/device/pose/haply.h"
#include "tests/fuzz/harness.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace trocar;           // NOLINT(google-build-using-namespace)
  using namespace trocar::runtime;  // NOLINT(google-build-using-namespace)
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto inventory = parse_haply_inventory(text);
  if (!inventory) fuzz::expect_refusal(inventory.error());
  HaplyDevices devices{{"inverse3", "049D"}, HaplyDevice{"verse_grip", "61548"}};
  if (inventory && !inventory->arms.empty()) devices = {inventory->arms.back().device, {}};
  const HaplyAnswer answer = parse_haply_answer(text, devices);
  const bool is_state = answer.kind == HaplyAnswer::Kind::kState;
  if (is_state != answer.why.empty() || answer.why.size() > 300) fuzz::fail("no short reason");
  if (haply_force_message(devices, {-1e-300 / 3, 1, 1}).size() > kMaxHaplyCommandBytes)
    fuzz::fail("a long command");
  if (!is_state) return 0;
  const auto& q = answer.state.q;
  for (const double x : answer.state.p_m)
    if (!(std::abs(x) <= 10)) fuzz::fail("an invalid position");
  if (!(std::abs(std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]) - 1) <= 1.001e-3))
    fuzz::fail("an invalid orientation");
  return 0;
}
