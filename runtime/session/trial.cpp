// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/trial.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace trocar::runtime {
namespace {

constexpr double kEveryTick_Hz = 1e9;

/// The sheet of a row's active slice, which in contact lies above the tip by the penetration. A
/// scene may have the same slice at several heights.
std::size_t active_sheet(const RecordingRow& row,
                         const std::vector<std::unique_ptr<const Sheet>>& sheets) {
  const double z_m = row.tool_m[2] + row.penetration_m;
  std::size_t nearest = 0;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < sheets.size(); ++i) {
    const double distance_m = std::abs(sheets[i]->z_m - z_m);
    if (sheets[i]->slice_index != row.active_slice || !(distance_m < least)) continue;
    least = distance_m;
    nearest = i;
  }
  return nearest;
}

/// Sees every row of a trial.
class Observer {
 public:
  Observer(const std::vector<std::unique_ptr<const Sheet>>& sheets, Trial& trial)
      : sheets_(sheets), trial_(trial) {}

  void see(const RecordingRow& row) {
    if (trial_.at_fault.fault != Fault::kNone) return;  // the ramp
    if (row.fault != Fault::kNone) {
      trial_.at_fault = row;
      return;
    }
    trial_.tip_lowest_m = std::min(trial_.tip_lowest_m, row.tool_m[2]);
    if (row.wrench_scale < 1 && row.authority >= 1) {
      if (trial_.scale_min == 1) trial_.scaled_t_s = row.t_s;
      trial_.scale_min = std::min(trial_.scale_min, row.wrench_scale);
    }
    const bool beside = row.phase == ContactPhase::kBeside;
    if (!beside && row.phase != ContactPhase::kContact) return;
    SheetTrial& sheet = trial_.sheets[active_sheet(row, sheets_)];
    sheet.passed_beside = sheet.passed_beside || beside;
    if (beside) return;
    touch(sheet, row.t_s);
    sheet.borne_t_s = row.t_s;
    sheet.force_max_N = std::max(sheet.force_max_N, row.wrench_wanted[2]);
  }

  static void touch(SheetTrial& sheet, double t_s) {
    if (!sheet.touched) sheet.touched_t_s = t_s;
    sheet.touched = true;
  }

 private:
  const std::vector<std::unique_ptr<const Sheet>>& sheets_;
  Trial& trial_;
};

}  // namespace

Result<Trial> run_trial(const Scene& scene, const DeviceDescription& description,
                        const std::vector<std::unique_ptr<const Sheet>>& sheets,
                        const SessionOptions& options) {
  Result<SimulatedDevice> device = make_simulated_device(scene, description);
  if (!device) return device.error();
  Trial trial;
  trial.session_ticks = tick_count(options.duration_s, options.rate_Hz);
  trial.tip_lowest_m = std::numeric_limits<double>::infinity();
  trial.sheets.resize(sheets.size());
  Observer observer(sheets, trial);

  SessionOptions silent;
  silent.clock = Clock::kVirtual;
  silent.rate_Hz = options.rate_Hz;
  silent.duration_s =
      static_cast<double>(std::min(trial.session_ticks, kMaxTrialTicks)) / options.rate_Hz;
  silent.handover_ticks = options.handover_ticks;
  silent.response_period_s = options.response_period_s;
  silent.limits = options.limits;
  silent.limits.gap_max_s = 0;
  silent.passivity = options.passivity;
  silent.coupling = options.coupling;
  silent.compensation = options.compensation;
  silent.stop = options.stop;
  silent.frame_rate_Hz = kEveryTick_Hz;
  silent.on_frame = [&](const RecordingRow& row, const auto&) { observer.see(row); };
  Remesher remesher(sheets);
  const Result<SessionReport> report = run_session(
      scene, description, remesher, *device, [&](double dt_s) { device->advance(dt_s); }, silent);
  if (!report) return report.error();

  trial.ticks = report->ticks;
  if (!report->faults.empty()) {
    trial.fault = report->faults.front().detail;
    trial.fault_t_s = report->faults.front().t_s;
  }
  trial.force_max_N = report->max_force_N;
  trial.torque_max_Nm = report->torque_max_Nm;
  trial.scaled_ticks = report->scaled_ticks;
  for (const PunctureEvent& event : report->punctures) {
    SheetTrial& sheet = trial.sheets[static_cast<std::size_t>(event.sheet)];
    Observer::touch(sheet, event.t_s);
    if (sheet.punctured_t_s < 0) sheet.punctured_t_s = event.t_s;
    sheet.force_max_N = std::max(sheet.force_max_N, event.force_N);
  }
  for (const CutRecord& record : remesher.records()) {
    if (!record.error) continue;
    trial.hole_error = record.error;
    break;
  }
  return trial;
}

}  // namespace trocar::runtime
