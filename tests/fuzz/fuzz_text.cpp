// SPDX-License-Identifier: GPL-3.0-or-later
// Text inputs of a session, given to every reader: a recording to be replayed, a device
// description, a scene, a plan of injected faults, the link's key. Accepted values are in their
// documented ranges; a recording that is written and read again is unchanged.
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "formats/base/files.h"
#include "formats/session/device_description.h"
#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/device/link/link_key.h"
#include "runtime/device/simulated/drive.h"
#include "runtime/session/session.h"
#include "runtime/session/session_options.h"
#include "tests/fuzz/harness.h"

namespace {

using namespace trocar;           // NOLINT(google-build-using-namespace): a program of one file
using namespace trocar::runtime;  // NOLINT(google-build-using-namespace)
using fuzz::fail;

std::vector<std::uint8_t> written(const std::vector<RecordingRow>& rows) {
  const std::filesystem::path file = fuzz::as_file(nullptr, 0, ".csv");
  auto writer = RecordingWriter::open(file);
  if (!writer || !writer->append(rows) || !writer->commit()) fail("recording: cannot be written");
  return *read_file(file);
}

void check_recording(std::string_view text) {
  const auto rows = parse_recording(text, "input.csv");
  if (!rows) return fuzz::expect_refusal(rows.error());
  if (rows->empty()) fail("recording: no row");
  for (std::size_t i = 0; i < rows->size(); ++i) {
    const RecordingRow& row = (*rows)[i];
    bool finite = std::isfinite(row.t_s) && std::isfinite(row.penetration_m);
    for (const double torque_Nm : row.tau_Nm)
      finite = finite && std::isfinite(torque_Nm);
    if (!finite || (i > 0 && !(row.t_s > (*rows)[i - 1].t_s))) fail("recording: no time or torque");
  }
  const auto once = written(*rows);
  const auto again =
      parse_recording({reinterpret_cast<const char*>(once.data()), once.size()}, "again.csv");
  if (!again || written(*again) != once) fail("recording: writing and reading changes it");
  const Result<double> rate_Hz = recorded_rate_Hz(*rows, "input.csv");
  if (!rate_Hz) return fuzz::expect_refusal(rate_Hz.error());
  if (!(*rate_Hz > 0 && std::isfinite(*rate_Hz))) fail("recording: an invalid rate");
}

void check_description(std::string_view text) {
  const auto description = parse_device_description(text, "input.json");
  if (!description) return fuzz::expect_refusal(description.error());
  const DeviceDescription& d = *description;
  for (const double number : {d.motor_peak_time_s, d.joint_viscous_friction_Nms_per_rad,
                              d.gravity_m_per_s2, d.maximum_substep_s, d.plate_mass_kg}) {
    if (!(number >= 0 && std::isfinite(number))) fail("description: an invalid value is accepted");
  }
}

void check_plan(std::string_view text) {
  const auto plan = parse_fault_plan(text);
  if (!plan) {
    if (plan.error().code != ExitCode::kUsage) fail("plan: " + plan.error().message);
    return;
  }
  for (const PlannedFault& fault : *plan) {
    const bool known = fault.probability >= 0 && fault.probability <= 1 && fault.delay_s >= 0 &&
                       fault.delay_s <= 10 && std::abs(fault.jump_rad) <= 100 &&
                       fault.from_s >= 0 && fault.from_s <= fault.to_s && fault.channel >= 0 &&
                       fault.channel < 16;
    if (!known) fail("plan: an invalid fault is accepted");
  }
  const FaultyLink link(*plan, LinkDirection::kStates, 1);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  check_recording(text);
  check_description(text);
  check_plan(text);
  if (const auto scene = parse_scene(text, "input.json", ""); !scene)
    fuzz::expect_refusal(scene.error());
  if (const auto key = read_link_key(fuzz::as_file(data, size, ".key")); !key)
    fuzz::expect_refusal(key.error());
  return 0;
}
