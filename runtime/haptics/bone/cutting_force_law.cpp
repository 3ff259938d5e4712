// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/bone/cutting_force_law.h"

#include <nlohmann/json.hpp>

#include "formats/base/json.h"
#include "formats/base/text.h"

namespace trocar::runtime {
namespace {

constexpr double kMuch_N = 1e4, kMuch_Nm = 1e3;
constexpr double kMinLever_m = 0.05;
constexpr double kUnlimited = std::numeric_limits<double>::infinity();

/// A cut is a break if less than this fraction of the force on the tip is left.
constexpr double kBreakShare = 0.5;
/// Force up to which quiet_N() is constant.
constexpr double kKnee_N = kQuiet_N / kQuietShare;
/// Extension at 20 N, or at the device's largest force, above which a user is told.
constexpr double kMostExtension_m = 3e-3;
/// Largest tangents that are tried, as parts of the stable one.
constexpr int kTangents = 28;
constexpr double kLeastTangent = 3e-3;

double lever_of(const BoneVolume& bone) noexcept {
  return std::max(bone.tool.tip_plate_m.norm(), kMinLever_m);
}

/// The stiffening spring in translation with a largest tangent and the led position's step s.
StiffeningSpring quiet_spring(double stiff_N_per_m, double step_m) noexcept {
  const double soft = step_m > 0 ? std::min(quiet_N(0) / step_m, stiff_N_per_m) : stiff_N_per_m;
  return {soft, stiff_N_per_m, kKnee_N};
}

/// Largest step of the led position at rest.
double step_of(const AxisEstimator& estimator, const LoopTiming& timing, PlateAxis axis) {
  axis.resolution_m *= kSeveral;
  return step_gain(estimator, timing.period_s).alternation_m(axis);
}

/// The quiet spring with the least extension at kPress_N, with a tangent of at most `most_N_per_m`.
StiffeningSpring best_spring(const LoopTiming& timing, const PlateAxis& axis, double most_N_per_m) {
  StiffeningSpring best;
  double least_m = kUnlimited;
  const bool is_exact = !(axis.noise_m > 0 || axis.resolution_m > 0);
  for (int i = 0; i < (is_exact ? 1 : kTangents); ++i) {
    const double stiff = most_N_per_m * std::pow(kLeastTangent, i / (kTangents - 1.0));
    const auto estimator = design_estimator(timing, axis, stiff);
    if (!estimator) continue;
    const StiffeningSpring spring = quiet_spring(stiff, step_of(*estimator, timing, axis));
    const double extension_m = length_at(spring, kPress_N);
    if (!(extension_m < least_m)) continue;
    least_m = extension_m;
    best = spring;
  }
  return best;
}

/// Stiffness of the tissue at the plate, an upper bound.
struct Stiffness {
  double translation_N_per_m = 0, rotation_Nm_per_rad = 0;
};
Stiffness tissue_of(const BoneVolume& bone, double period_s) {
  const double along_N_per_m = std::max(bone.along_N_per_m, bone.viscous_N_s_per_m / period_s);
  const double translation_N_per_m = std::max(along_N_per_m, bone.across_N_per_m);
  const double lever_m = bone.tool.tip_plate_m.norm() + 0.05;
  const double offset2_m2 = bone.tool.tip_plate_m.cross(bone.tool.axis_plate).squaredNorm();
  return {translation_N_per_m,
          bone.across_N_per_m * lever_m * lever_m + along_N_per_m * offset2_m2};
}

void limit_force(const BoneVolume& bone, const DeviceSpecification& device,
                 const Pose& T_device_plate, DeviceCoupling& out) {
  if (!device.damping(T_device_plate)) return;
  const auto given = [&](const Wrench& wrench) {
    return device.renderable_fraction(T_device_plate, wrench);
  };
  Wrench wrench = Wrench::Zero();
  wrench.head<3>() = kMuch_N * (T_device_plate.q * bone.tool.axis_plate);
  out.max_N = kMuch_N * given(wrench) / out.force_scale;
  out.coupling.max_force_N = out.max_N;
  for (int i = 0; i < 3; ++i) {
    wrench.setZero();
    wrench[3 + i] = kMuch_Nm;
    out.coupling.max_moment_Nm =
        std::min(out.coupling.max_moment_Nm, kMuch_Nm * given(wrench) / out.force_scale);
  }
}

/// Returns the lowest whole rate above `rate_Hz` at which there is a coupling; 0 if there is none.
double lowest_rate_Hz(const BoneVolume& bone, const ForceLawSetup& setup,
                      const Pose& T_device_plate) {
  const auto is_enough = [&](double rate_Hz) {
    return static_cast<bool>(choose_coupling(bone, setup.scene.force_law, setup.device,
                                             T_device_plate, rate_Hz, setup.stiffness));
  };
  double low_Hz = std::floor(setup.rate_Hz), high_Hz = kMaxRate_Hz;
  if (!is_enough(high_Hz)) return 0;
  while (high_Hz - low_Hz > 1) {
    const double middle_Hz = std::floor((low_Hz + high_Hz) / 2);
    (is_enough(middle_Hz) ? high_Hz : low_Hz) = middle_Hz;
  }
  return high_Hz;
}

}  // namespace

double DeviceCoupling::extension_m(double force_N) const noexcept {
  return coupling.is_rigid ? 0 : length_at(coupling.translation(), force_N / force_scale);
}

Result<DeviceCoupling> choose_coupling(const BoneVolume& bone, const SceneForceLaw& law,
                                       const DeviceSpecification& device,
                                       const Pose& T_device_plate, double rate_Hz,
                                       const StiffnessLimits& limits) {
  DeviceCoupling out;
  const double scale = out.force_scale = law.force_scale, lever_m = lever_of(bone);
  const LoopTiming timing{1 / rate_Hz, device.readings().delay_s};
  const PlateAxes axes = plate_axes(device, T_device_plate);
  const double ceiling_N_per_m = limits.most_N_per_m(device);

  // The spring in rendered units.
  StiffeningSpring spring, turning;
  const double stable = stable_stiffness(timing, axes.translation, limits.margin),
               most = std::min(stable, ceiling_N_per_m), stated = scale * law.coupling_N_per_m;
  spring = stated > 0 ? StiffeningSpring{std::min(stated, most), std::min(stated, most), kKnee_N}
                      : best_spring(timing, axes.translation, most);
  out.is_at_ceiling = ceiling_N_per_m < (stated > 0 ? std::min(stated, stable) : stable);
  const double lever2_m2 = lever_m * lever_m, stated_turn = scale * law.coupling_Nm_per_rad,
               most_turn = std::min(stable_stiffness(timing, axes.rotation, limits.margin),
                                    ceiling_N_per_m * lever2_m2);
  turning.stiff = std::min(stated_turn > 0 ? stated_turn : spring.stiff * lever2_m2, most_turn);
  turning.soft = stated_turn > 0 ? turning.stiff : std::min(spring.soft * lever2_m2, turning.stiff);
  turning.knee = spring.knee * lever_m;
  CuttingCoupling& coupling = out.coupling = bone.options.coupling;
  coupling.translation_N_per_m = spring.stiff / scale;
  coupling.soft_N_per_m = spring.soft / scale;
  coupling.knee_N = spring.knee / scale;
  coupling.rotation_Nm_per_rad = turning.stiff / scale;
  coupling.soft_Nm_per_rad = turning.soft / scale;
  coupling.knee_Nm = turning.knee / scale;

  const Stiffness tissue = tissue_of(bone, timing.period_s);
  const double lag2_s2 = timing.lag_s() * timing.lag_s();
  const double share = scale * lag2_s2 *
                       std::max(tissue.translation_N_per_m / axes.translation.mass_kg,
                                tissue.rotation_Nm_per_rad / axes.rotation.mass_kg);
  const bool may_be_rigid =
      scale * (tissue.translation_N_per_m + bone.yielding_N_per_m) <= ceiling_N_per_m;
  const bool is_softer = tissue.translation_N_per_m <= coupling.soft_N_per_m &&
                         tissue.rotation_Nm_per_rad <= coupling.soft_Nm_per_rad;
  coupling.is_rigid =
      may_be_rigid && (law.axis == ToolAxis::kRigid ||
                       (law.axis == ToolAxis::kAuto && is_softer && share <= kMaxRigidShare));
  if (coupling.is_rigid && !(share <= kMaxRigidShare))
    return refused(text_line(
        "force_law: the tissue is too stiff for a rigid axis at %.6g Hz: K tau^2 / M is %.3g, with "
        "the stiffness K, the age tau of the force and the plate's inertia M, and at most %.3g is "
        "stable: leave out \"axis\", lower the force scale, or raise --rate",
        rate_Hz, share, kMaxRigidShare));
  limit_force(bone, device, T_device_plate, out);
  const RenderedStiffness rendered = coupling.is_rigid
                                         ? RenderedStiffness{scale * tissue.translation_N_per_m,
                                                             scale * tissue.rotation_Nm_per_rad}
                                         : RenderedStiffness{spring.stiff, turning.stiff};
  if (const auto ok = design_contact(device, axes, timing, rendered, limits,
                                     coupling.is_rigid ? kQuietTarget_N : 0)
                          .into(out.design);
      !ok)
    return ok.error().after("force_law: ");
  if (!coupling.is_rigid) {
    out.design.rest_N_per_m = spring.soft;
    out.design.alternation_m = step_of(out.design.estimator.translation, timing, axes.translation);
  }
  return out;
}

std::string describe(const DeviceCoupling& chosen, const SceneForceLaw& law) {
  const CuttingCoupling& coupling = chosen.coupling;
  const double scale = chosen.force_scale;
  std::string out = "coupling   tool axis rigid";
  if (!coupling.is_rigid) {
    out = text_line(
        "coupling   spring of %.4g N/m, above %.3g N stiffer up to %.4g N/m; %.4g to "
        "%.4g Nm/rad",
        scale * coupling.soft_N_per_m, scale * coupling.knee_N,
        scale * coupling.translation_N_per_m, scale * coupling.soft_Nm_per_rad,
        scale * coupling.rotation_Nm_per_rad);
    if (chosen.is_at_ceiling) out += " (the limit that the device or the operator states)";
    out += text_line("\n           extended by %.2g mm at 20 N and %.2g mm at 50 N on the hand",
                     1e3 * chosen.extension_m(20), 1e3 * chosen.extension_m(50));
  }
  return out +
         text_line("; at most %.4g N of tissue at force scale %.4g\n", chosen.max_N,
                   law.force_scale) +
         runtime::describe(chosen.design);
}

Result<std::unique_ptr<CuttingForceLaw>> CuttingForceLaw::make(const ForceLawSetup& setup) {
  Result<BoneVolume> bone = make_bone_volume(setup.scene, setup.sheets);
  if (!bone) return bone.error().after(setup.scene.asset.string() + ": ");
  const Pose T_device_plate = over_anchor(*setup.sheets.front(), bone->tool);
  const Result<DeviceCoupling> coupling = choose_coupling(
      *bone, setup.scene.force_law, setup.device, T_device_plate, setup.rate_Hz, setup.stiffness);
  if (!coupling) {
    const double enough_Hz = lowest_rate_Hz(*bone, setup, T_device_plate);
    return refused(coupling.error().message +
                   (enough_Hz > 0 ? text_line(" (at least %.0f Hz would do)", enough_Hz) : ""));
  }
  bone->options.coupling = coupling->coupling;
  return std::unique_ptr<CuttingForceLaw>(new CuttingForceLaw(setup, std::move(*bone), *coupling));
}

CuttingForceLaw::CuttingForceLaw(const ForceLawSetup& setup, BoneVolume bone,
                                 const DeviceCoupling& coupling)
    : bone_(std::move(bone)),
      state_(make_bone_contact_state(bone_)),
      law_(setup.scene.force_law),
      has_unused_damping_(
          std::any_of(setup.sheets.begin(), setup.sheets.end(),
                      [](const Sheet* sheet) { return sheet->tissue.damping_N_s_per_m > 0; })) {
  report_.coupling = coupling;
  const ContactDesign& design = coupling.design;
  escape_m_per_s_ = kEscape_m_per_s + kEscapeSigmas * speed_noise(design.estimator.translation,
                                                                  design.timing.period_s,
                                                                  design.axes.translation);
}

/// Fades the wrench while the plate is thrown back along the force, so that a hand that lets go is
/// not pushed away. It only takes away force that works on the hand.
void CuttingForceLaw::damp_escape(const Twist& twist_device, ContactOutput& output) noexcept {
  const Eigen::Vector3d force_N = output.wrench_device.head<3>();
  const double size_N = force_N.norm();
  if (!(size_N > 0)) return;
  const double outward = twist_device.head<3>().dot(force_N) / size_N;
  const double left = 1 - std::clamp((outward - escape_m_per_s_) / kEscapeWidth_m_per_s, 0.0, 1.0);
  if (!(left < 1)) return;
  output.wrench_device *= left;
  state_.wrench_device *= left;
}

FaultDetail CuttingForceLaw::update(const ForceLawInput& input, ContactOutput& output) noexcept {
  update_bone_contact(bone_, input.sheets, input.T_device_measured, input.T_device_plate,
                      input.pose_interval_s, contact_.tracks, state_, output);
  output.T_device_evaluated = input.T_device_plate;
  damp_escape(input.twist_device, output);
  for (const CutRequest& cut : output.cut_list)
    report_.side_cuts += cut.is_puncture ? 0 : 1;
  if (output.not_upright) return {};
  output.layers_punctured = state_.result.layers_punctured;
  const double force_N = law_.force_scale * output.force_N;
  output.force_before_N = std::exchange(last_force_N_, output.force_N);
  const double before_N = law_.force_scale * output.force_before_N;
  const CuttingResult& result = state_.result;
  const bool has_cut =
      result.cut_J > 0 || result.passed_to > result.passed_from || output.layers_punctured != 0;
  if (has_cut && force_N < kBreakShare * before_N) output.lost_force_N = before_N - force_N;
  if (output.backlog) return {};
  output.wrench_device *= law_.force_scale;
  output.local.stored_J *= law_.force_scale;
  output.wrench_plate = output.wrench_device;
  output.stored_J = output.local.stored_J;
  return {};
}

void CuttingForceLaw::reset_motion() noexcept {
  runtime::reset_motion(state_);
  last_force_N_ = 0;
}

void CuttingForceLaw::finish_tick(RecordingRow& row) noexcept {
  if (state_.law.has_begun) {
    const Eigen::Vector3d tip_m = state_.law.T_device_proxy * bone_.tool.tip_plate_m;
    row.tool_m = {tip_m.x(), tip_m.y(), tip_m.z()};
  }
  const CuttingResult& result = state_.result;
  RecordingRow::Cutting& columns = row.cutting;
  std::copy(state_.wrench_device.data(), state_.wrench_device.data() + 6,
            columns.wrench_tissue.begin());
  // Below the last slab there is nothing left to cut.
  columns.front_z_m = std::isfinite(result.front_m) ? -result.front_m : 0;
  columns.front_HU = state_.front_HU;
  columns.embedded_m = result.embedded_m;
  columns.cut_J = state_.energy.cut_J;
  columns.absorbed_J = state_.energy.absorbed_J;
  columns.stored_J = result.stored_J;
  columns.steps = result.steps;

  report_.tip_max_N = std::max(report_.tip_max_N, row.tip_N);
  report_.tissue_max_N = std::max(report_.tissue_max_N, result.wrench_device.head<3>().norm());
  if (!result.has_converged) ++report_.unconverged_ticks;
  report_.steps_max = std::max(report_.steps_max, result.steps);
  report_.energy = state_.energy;
}

double CuttingForceLaw::retract_distance_m(std::span<const Sheet* const> sheets,
                                           const Pose& T_device_plate) const noexcept {
  return runtime::retract_distance_m(bone_, sheets, T_device_plate, state_);
}

std::string CuttingForceLaw::describe() const {
  const auto joined = static_cast<std::size_t>(
      std::count_if(bone_.sheets.begin(), bone_.sheets.end(),
                    [](const BoneSheet& sheet) { return sheet.bottom_m > sheet.top_m; }));
  const std::size_t shells = bone_.sheets.size() - joined;
  std::string out = text_line(
      "force law  cutting\n"
      "body       %zu slices as %zu slabs of one body, %zu as shells of no thickness\n",
      joined, bone_.slabs.size() - shells, shells);
  if (bone_.shell_m > 0)
    out += text_line("           cortical shell of %.3g mm\n", 1e3 * bone_.shell_m);
  out += runtime::describe(report_.coupling, law_);
  const auto by_hu = std::find_if(bone_.sheets.begin(), bone_.sheets.end(),
                                  [](const BoneSheet& sheet) { return sheet.law != nullptr; });
  if (by_hu != bone_.sheets.end()) {
    const HuCalibration& c = by_hu->calibration;
    out += text_line("bone       law %.*s; %.*s = %.4g + %.4g HU g/cm^3%s\n",
                     static_cast<int>(by_hu->law->name.size()), by_hu->law->name.data(),
                     static_cast<int>(name_of(c.kind).size()), name_of(c.kind).data(), c.at_0_HU,
                     c.per_HU, c.is_assumed ? ", assumed: the scene does not give it" : "");
  }
  if (has_unused_damping_)
    out += "           the tissue's damping_N_s_per_m is not used by this law\n";
  return out;
}

TipForce CuttingForceLaw::tip_force(std::size_t index, const Sheet& /*sheet*/) const {
  return {bone_.sheets[index].tip_N_per_m, bone_.sheets[index].nominal_N, law_.force_scale};
}

std::string CuttingForceLaw::contact_warning() const {
  const DeviceCoupling& chosen = report_.coupling;
  if (std::string warning = runtime::contact_warning(chosen.design); !warning.empty())
    return warning;
  const double force_N = std::min(20.0, chosen.force_scale * chosen.max_N);
  const double extension_m = chosen.extension_m(force_N);
  if (!(extension_m > kMostExtension_m)) return {};
  return text_line(
      "the readings' noise and resolution, or the delay, allow only a soft coupling, which gives "
      "way "
      "by %.1f mm at %.3g N: the tool stays behind the hand and walls stay uncut; raise --rate or "
      "lower the force scale",
      1e3 * extension_m, force_N);
}

SummarySection CuttingForceLaw::summary() const {
  const CuttingCoupling& coupling = report_.coupling.coupling;
  const ContactDesign& design = report_.coupling.design;
  const PlateAxes& axes = design.axes;
  const double T_s = design.timing.period_s, K = design.rendered.translation_N_per_m,
               turn = design.rendered.rotation_Nm_per_rad;
  nlohmann::json section = {
      {"axis", coupling.is_rigid ? "rigid" : "coupled"},
      {"coupling_N_per_m", nullptr},
      {"coupling_Nm_per_rad", nullptr},
      {"coupling_soft_N_per_m", nullptr},
      {"stable_N_per_m", design.stable_N_per_m},
      {"lead_s", design.estimator.translation.lead_s},
      {"pose_is_predicted", design.estimator.translation.lead_s > 0},
      {"inertia_share",
       T_s * T_s * std::max(K / axes.translation.mass_kg, turn / axes.rotation.mass_kg)},
      {"device_damping_share", 2 / T_s *
                                   std::min(axes.translation.damping_N_s_per_m / K,
                                            axes.rotation.damping_N_s_per_m / turn)},
      {"force_scale", report_.coupling.force_scale},
      {"tissue_max_N", report_.tissue_max_N},
      {"tip_max_N", report_.tip_max_N},
      {"front_work_J", report_.energy.cut_J},
      {"absorbed_J", report_.energy.absorbed_J},
      {"stored_J", report_.energy.stored_J},
      {"given_max_J", report_.energy.released_max_J},
      {"newton_steps_max", report_.steps_max},
      {"unconverged_ticks", report_.unconverged_ticks},
      {"side_cuts", report_.side_cuts}};
  if (!coupling.is_rigid) {
    section["coupling_N_per_m"] = coupling.translation_N_per_m;
    section["coupling_Nm_per_rad"] = coupling.rotation_Nm_per_rad;
    section["coupling_soft_N_per_m"] = coupling.soft_N_per_m;
  }
  return {"cutting", json_text(section)};
}

Result<std::unique_ptr<ForceLaw>> make_cutting_law(const ForceLawSetup& setup) {
  Result<std::unique_ptr<CuttingForceLaw>> law = CuttingForceLaw::make(setup);
  if (!law) return law.error();
  return std::unique_ptr<ForceLaw>(std::move(*law));
}

}  // namespace trocar::runtime
