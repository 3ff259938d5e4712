// SPDX-License-Identifier: Apache-2.0
#include "runtime/check/dry_run.h"

namespace trocar::runtime {
namespace {

constexpr double kContact_N = 0.5;

Eigen::Vector3d plate_of(const RecordingRow& row) noexcept {
  return Eigen::Vector3d(row.p_m.data());
}

/// Returns the sheet of a row's active slice. In contact it lies above the tip by the penetration,
/// which selects one if the scene has the same slice at several heights. Precondition: the row has
/// an active slice.
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

/// Evaluates every tick of a dry run.
class DryRunObserver final : public TickObserver {
 public:
  DryRunObserver(const Scene& scene, const std::vector<std::unique_ptr<const Sheet>>& sheets,
                 DryRun& dry_run)
      : sheets_(sheets),
        dry_run_(dry_run),
        feel_(make_tool(scene.tool).tip_plate_m, scene.hand.let_go_t_s) {}

  const ContactFeel& feel() const noexcept { return feel_.feel(); }

  void on_tick(const TickView& tick) noexcept override {
    const RecordingRow& row = tick.result.row;
    if (dry_run_.at_fault.fault != Fault::kNone) return;  // forces are ramped down
    if (row.fault != Fault::kNone) {
      dry_run_.at_fault = row;
      return;
    }
    feel_.add(row);
    dry_run_.tip_lowest_m = std::min(dry_run_.tip_lowest_m, row.tool_m[2]);
    if (row.wrench_scale < 1 && row.authority >= 1) {
      if (dry_run_.scale_min == 1) dry_run_.scaled_t_s = row.t_s;
      dry_run_.scale_min = std::min(dry_run_.scale_min, row.wrench_scale);
    }
    const bool missed = row.phase == ContactPhase::kMissed;
    if (!missed && row.phase != ContactPhase::kContact) return;
    if (row.active_slice < 0) return;  // in contact with a soft layer, and not with a sheet
    SheetDryRun& sheet = dry_run_.sheets[active_sheet(row, sheets_)];
    sheet.missed = sheet.missed || missed;
    if (missed) return;
    touch(sheet, row.t_s);
    sheet.loaded_t_s = row.t_s;
    sheet.force_max_N = std::max(sheet.force_max_N, row.wrench_wanted[2]);
  }

  static void touch(SheetDryRun& sheet, double t_s) {
    if (!sheet.touched) sheet.touched_t_s = t_s;
    sheet.touched = true;
  }

 private:
  const std::vector<std::unique_ptr<const Sheet>>& sheets_;
  DryRun& dry_run_;
  ContactFeelMeter feel_;
};

}  // namespace

void ContactFeelMeter::add(const RecordingRow& row) noexcept {
  feel_.wanted_least_N = std::min(feel_.wanted_least_N, row.wrench_wanted[2]);
  feel_.wanted_most.include(row.wrench_wanted[2], row.t_s);
  if (Eigen::Vector3d(row.wrench_wanted.data()).norm() > kContact_N) {
    if (feel_.contact_from_s < 0) feel_.contact_from_s = row.t_s;
    feel_.contact_to_s = row.t_s;
  }
  if (has_last_) {
    add_front(row);
    add_alternation(row);
  }
  add_let_go(row);
  last_ = row;
  has_last_ = true;
}

void ContactFeelMeter::add_front(const RecordingRow& row) noexcept {
  if (row.tip_N > 0) {
    const Eigen::Quaterniond q(row.q[0], row.q[1], row.q[2], row.q[3]);
    const Eigen::Vector3d tip_m = plate_of(row) + q * tip_plate_m_;
    feel_.past_front.include(row.cutting.front_z_m - tip_m.z(), row.t_s);
  }
  // A front that has reached a gap is the next bone below, which the tip may not have reached.
  if (row.cutting.cut_J > last_.cutting.cut_J)
    feel_.front_jump.include(
        last_.cutting.front_z_m - std::max(row.cutting.front_z_m, row.tool_m[2]), row.t_s);
}

void ContactFeelMeter::add_alternation(const RecordingRow& row) noexcept {
  for (std::size_t axis = 0; axis < changes_N_.size(); ++axis) {
    auto& changes = changes_N_[axis];
    std::rotate(changes.begin(), changes.end() - 1, changes.end());
    changes[0] = row.wrench_wanted[axis] - last_.wrench_wanted[axis];
    double least_N = std::abs(changes[0]);
    for (std::size_t i = 1; i < changes.size(); ++i)
      least_N = changes[i] * changes[i - 1] < 0 ? std::min(least_N, std::abs(changes[i])) : 0;
    feel_.alternation.include(least_N, row.t_s);
  }
}

void ContactFeelMeter::add_let_go(const RecordingRow& row) noexcept {
  if (!let_go_t_s_ || row.t_s < *let_go_t_s_) return;
  if (!let_go_p_m_) {
    let_go_p_m_ = plate_of(row);
    return;
  }
  feel_.let_go_distance_m =
      std::max(feel_.let_go_distance_m, (plate_of(row) - *let_go_p_m_).norm());
  if (row.t_s > last_.t_s)
    feel_.let_go_speed_m_per_s =
        std::max(feel_.let_go_speed_m_per_s,
                 (plate_of(row) - plate_of(last_)).norm() / (row.t_s - last_.t_s));
}

Result<DryRun> run_dry_run(const Scene& scene, const DeviceToCheck& device,
                           const std::vector<std::unique_ptr<const Sheet>>& sheets,
                           const SessionOptions& options) {
  const Result<std::shared_ptr<HandDevice>> simulated = device.simulate(scene);
  if (!simulated) return simulated.error();
  DryRun dry_run;
  dry_run.session_ticks = tick_count(options.duration_s, options.rate_Hz);
  dry_run.tip_lowest_m = std::numeric_limits<double>::infinity();
  dry_run.sheets.resize(sheets.size());
  DryRunObserver observer(scene, sheets, dry_run);

  SessionOptions silent;
  silent.clock = Clock::kVirtual;
  silent.rate_Hz = options.rate_Hz;
  silent.duration_s =
      static_cast<double>(std::min(dry_run.session_ticks, kMaxDryRunTicks)) / options.rate_Hz;
  silent.limits = options.limits;
  silent.limits.gap_max_s = 0;
  silent.guards = options.guards;
  silent.coupling = options.coupling;
  silent.stiffness = options.stiffness;
  silent.compensation = options.compensation;
  silent.stop = options.stop;
  silent.observers = {&observer};
  Remesher remesher(sheets);
  HandDevice& hand_device = **simulated;
  const Result<SessionResult> report = run_session(
      scene, remesher, hand_device, [&](double dt_s) { hand_device.advance(dt_s); }, silent);
  if (!report) return report.error();
  if (options.is_stopped()) return interrupted();

  dry_run.ticks = report->ticks;
  dry_run.feel = observer.feel();
  if (!report->faults.empty()) {
    dry_run.fault = report->faults.front().detail;
    dry_run.fault_t_s = report->faults.front().t_s;
  }
  dry_run.force_max_N = report->max_force_N;
  dry_run.torque_max_Nm = report->torque_max_Nm;
  dry_run.scaled_ticks = report->scaled_ticks;
  for (const PunctureEvent& event : report->punctures) {
    SheetDryRun& sheet = dry_run.sheets[static_cast<std::size_t>(event.sheet)];
    DryRunObserver::touch(sheet, event.t_s);
    if (sheet.punctured_t_s < 0) sheet.punctured_t_s = event.t_s;
    sheet.force_max_N =
        std::max(sheet.force_max_N, scene.force_law.force_scale * event.tip_N);  // as rendered
  }
  for (const CutRecord& record : remesher.records()) {
    if (!record.error) continue;
    dry_run.hole_error = record.error;
    break;
  }
  return dry_run;
}

Result<std::optional<LetGoTrial>> try_letting_go(
    const Scene& scene, const DeviceToCheck& device,
    const std::vector<std::unique_ptr<const Sheet>>& sheets, const SessionOptions& options,
    const DryRun& dry_run, const std::function<bool(const LetGoTrial&)>& is_enough) {
  const double from_s = dry_run.feel.contact_from_s,
               to_s = std::min(dry_run.feel.contact_to_s,
                               scene.hand.let_go_t_s.value_or(dry_run.feel.contact_to_s));
  if (dry_run.fault != Fault::kNone || !(to_s > from_s)) return std::optional<LetGoTrial>();
  LetGoTrial worst;
  for (int i = 0; i < kLetGoMoments; ++i) {
    Scene lets_go = scene;
    const double t_s = i == 0 ? std::min(dry_run.feel.wanted_most.t_s, to_s)
                              : from_s + (i - 0.5) / (kLetGoMoments - 1) * (to_s - from_s);
    lets_go.hand.let_go_t_s = t_s;
    SessionOptions shortened = options;
    shortened.duration_s = std::min(options.duration_s, t_s + kLetGoAfter_s);
    const Result<DryRun> tried = run_dry_run(lets_go, device, sheets, shortened);
    if (!tried) return tried.error();
    ++worst.moments;
    if (worst.fault == Fault::kNone) worst.fault = tried->fault;
    worst.distance_m = std::max(worst.distance_m, tried->feel.let_go_distance_m);
    if (tried->feel.let_go_speed_m_per_s > worst.speed_m_per_s) {
      worst.speed_m_per_s = tried->feel.let_go_speed_m_per_s;
      worst.t_s = t_s;
    }
    if (is_enough && is_enough(worst)) break;
  }
  return std::optional(worst);
}

}  // namespace trocar::runtime
