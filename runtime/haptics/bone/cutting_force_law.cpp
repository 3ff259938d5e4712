// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/bone/cutting_force_law.h"

#include <nlohmann/json.hpp>

#include "formats/base/json.h"
#include "formats/base/text.h"
#include "runtime/device/symmetric_eigenvalues.h"

namespace trocar::runtime {
namespace {

constexpr double kMuch_N = 1e4, kMuch_Nm = 1e3;
constexpr double kMinLever_m = 0.05;
constexpr double kUnlimited = std::numeric_limits<double>::infinity();

struct Stiffness {
  double translation_N_per_m = 0, rotation_Nm_per_rad = 0;
};

bool is_softer(const Stiffness& tissue, const CuttingCoupling& coupling) {
  return tissue.translation_N_per_m <= coupling.translation_N_per_m &&
         tissue.rotation_Nm_per_rad <= coupling.rotation_Nm_per_rad;
}

// Returns 0, as for a device without damping, if the eigenvalues cannot be computed.
double damping_share(const Eigen::Matrix<double, 6, 6>& B, const Stiffness& K, double T_s) {
  Eigen::Matrix<double, 6, 1> per;
  per << Eigen::Vector3d::Constant(1 / std::sqrt(K.translation_N_per_m * T_s / 2)),
      Eigen::Vector3d::Constant(1 / std::sqrt(K.rotation_Nm_per_rad * T_s / 2));
  const Eigen::Matrix<double, 6, 6> scaled = per.asDiagonal() * B * per.asDiagonal();
  const auto eigenvalues = symmetric_eigenvalues(scaled);
  return eigenvalues ? (*eigenvalues)[0] : 0;
}

/// A cut is a break if less than this fraction of the force on the tip is left.
constexpr double kBreakShare = 0.5;

/// Returns the lowest whole rate above `rate_Hz` at which the chosen coupling is passive; 0 if there is none.
double lowest_passive_rate_Hz(const BoneVolume& bone, const ForceLawSetup& setup,
                              const Pose& T_device_plate) {
  const auto is_enough = [&](double rate_Hz) {
    return may_start(choose_coupling(bone, setup.scene.force_law, setup.device, T_device_plate,
                                     rate_Hz, setup.stiffness));
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

DeviceCoupling choose_coupling(const BoneVolume& bone, const SceneForceLaw& law,
                               const DeviceSpecification& device, const Pose& T_device_plate,
                               double rate_Hz, const StiffnessLimits& limits) {
  DeviceCoupling out;
  out.rate_Hz = rate_Hz;
  CuttingCoupling& coupling = out.coupling;
  coupling = bone.options.coupling;
  const double T_s = 1 / rate_Hz, scale = law.force_scale;
  const double along_N_per_m = std::max(bone.along_N_per_m, bone.viscous_N_s_per_m / T_s);
  const double tissue_N_per_m = std::max(along_N_per_m, bone.across_N_per_m);
  const double lever_m = bone.tool.tip_plate_m.norm() + 0.05;
  const double offset2_m2 = bone.tool.tip_plate_m.cross(bone.tool.axis_plate).squaredNorm();
  const Stiffness tissue{tissue_N_per_m,
                         bone.across_N_per_m * lever_m * lever_m + along_N_per_m * offset2_m2};
  const double per_inertia = kMaxInertiaShare / (T_s * T_s * scale * limits.margin);
  const std::array<double, 3> inertia_kg_m2 = device.inertia_kg_m2();
  const Stiffness most{per_inertia * device.mass_kg(),
                       per_inertia * *std::min_element(inertia_kg_m2.begin(), inertia_kg_m2.end())};
  const double stated_N_per_m =
      device.stiffness_max_N_per_m() > 0 ? device.stiffness_max_N_per_m() : kUnlimited;
  out.ceiling_N_per_m = std::min(stated_N_per_m, limits.max_N_per_m) / scale;
  if (!(law.coupling_N_per_m > 0)) coupling.translation_N_per_m = most.translation_N_per_m;
  if (!(law.coupling_Nm_per_rad > 0)) coupling.rotation_Nm_per_rad = most.rotation_Nm_per_rad;
  if (coupling.translation_N_per_m > out.ceiling_N_per_m) {
    // Rotation at the plate moves the tip, so its stiffness is limited likewise.
    const double tip_m = std::max(bone.tool.tip_plate_m.norm(), kMinLever_m);
    coupling.translation_N_per_m = out.ceiling_N_per_m;
    coupling.rotation_Nm_per_rad =
        std::min(coupling.rotation_Nm_per_rad, out.ceiling_N_per_m * tip_m * tip_m);
    out.is_at_ceiling = true;
  }
  const bool may_be_rigid = tissue_N_per_m + bone.yielding_N_per_m <= out.ceiling_N_per_m;
  coupling.is_rigid =
      may_be_rigid && (law.axis == ToolAxis::kRigid ||
                       (law.axis == ToolAxis::kAuto && is_softer(tissue, coupling)));
  const Stiffness K =
      coupling.is_rigid
          ? Stiffness{scale * tissue_N_per_m, scale * tissue_N_per_m * lever_m * lever_m}
          : Stiffness{scale * coupling.translation_N_per_m, scale * coupling.rotation_Nm_per_rad};

  if (const auto damping = device.damping(T_device_plate)) {
    out.damping_share = damping_share(*damping, K, T_s);
    const auto given = [&](const Wrench& wrench) {
      return device.renderable_fraction(T_device_plate, wrench);
    };
    const Eigen::Vector3d up = T_device_plate.q * bone.tool.axis_plate;
    Wrench wrench = Wrench::Zero();
    wrench.head<3>() = kMuch_N * up;
    out.max_N = kMuch_N * given(wrench) / scale;
    coupling.max_force_N = out.max_N;
    for (int i = 0; i < 3; ++i) {
      wrench.setZero();
      wrench[3 + i] = kMuch_Nm;
      coupling.max_moment_Nm = std::min(coupling.max_moment_Nm, kMuch_Nm * given(wrench) / scale);
    }
  }
  out.predicts_pose = law.prediction == PosePrediction::kOn ||
                      (law.prediction == PosePrediction::kAuto && out.damping_share < 1);
  if (out.predicts_pose) {
    coupling.translation_N_per_m = std::min(coupling.translation_N_per_m, most.translation_N_per_m);
    coupling.rotation_Nm_per_rad = std::min(coupling.rotation_Nm_per_rad, most.rotation_Nm_per_rad);
    // The tissue must be softer than the coupling after this limit, too.
    if (law.axis != ToolAxis::kRigid && !is_softer(tissue, coupling)) coupling.is_rigid = false;
  }
  const Stiffness rendered =
      coupling.is_rigid ? tissue
                        : Stiffness{coupling.translation_N_per_m, coupling.rotation_Nm_per_rad};
  out.rendered_N_per_m = rendered.translation_N_per_m;
  out.inertia_limit = kMaxInertiaShare / limits.margin;
  out.inertia_share =
      out.inertia_limit * std::max(rendered.translation_N_per_m / most.translation_N_per_m,
                                   rendered.rotation_Nm_per_rad / most.rotation_Nm_per_rad);
  return out;
}

std::string describe(const DeviceCoupling& chosen, const SceneForceLaw& law) {
  std::string out = "tool axis rigid";
  if (!chosen.coupling.is_rigid) {
    out = text_line("tool axis coupled, %.4g N/m and %.4g Nm/rad",
                    chosen.coupling.translation_N_per_m, chosen.coupling.rotation_Nm_per_rad);
    if (chosen.is_at_ceiling) out += " (the limit that the device or the operator states)";
  }
  return out +
         text_line(
             ", at most %.4g N of tissue at force scale %.4g"
             "; the device's damping holds %.3g of that stiffness: %s",
             chosen.max_N, law.force_scale, chosen.damping_share,
             chosen.predicts_pose ? "evaluated a tick ahead" : "evaluated where the plate is");
}

bool may_start(const DeviceCoupling& chosen) {
  constexpr double kRounding = 1e-9;
  const bool damping_suffices = !chosen.predicts_pose && chosen.damping_share >= 1;
  return damping_suffices ||
         chosen.inertia_share <= chosen.inertia_limit * (1 + kRounding);  // false for nan
}

std::string why_not_passive(const DeviceCoupling& chosen, double enough_Hz) {
  std::string out = text_line(
      "force_law: the stiffness K that is rendered is not passive at %.6g Hz: for the plate's "
      "inertia M and the tick T, K T^2 / M is %.3g, and at most %.3g is known to be passive: ",
      chosen.rate_Hz, chosen.inertia_share, chosen.inertia_limit);
  if (enough_Hz > 0) out += text_line("use a --rate of at least %.0f Hz, or ", enough_Hz);
  // A thousandth less, because the text rounds.
  const double most_N_per_m =
      0.999 * chosen.rendered_N_per_m * chosen.inertia_limit / chosen.inertia_share;
  out += text_line("instead of a stiffness of %.4g N/m at most %.4g N/m, or ",
                   chosen.rendered_N_per_m, most_N_per_m);
  return out + (chosen.coupling.is_rigid ? "leave out \"axis\""
                                         : "leave out \"prediction\" or lower coupling_N_per_m and "
                                           "coupling_Nm_per_rad");
}

std::string stability_warning(const DeviceCoupling& chosen) {
  if (!chosen.predicts_pose) {
    if (chosen.damping_share >= 1) return {};
    return text_line(
        "without prediction, the device's damping holds only %.3g of the stiffness that is "
        "rendered: leave out \"prediction\", or lower coupling_N_per_m and coupling_Nm_per_rad",
        chosen.damping_share);
  }
  if (chosen.rate_Hz >= kMinPredictedRate_Hz) return {};
  return text_line(
      "at this rate the predicted pose gives energy to motions faster than %.3g Hz, and "
      "a hand moves at up to %.0f Hz: raise --rate to at least %.0f",
      chosen.rate_Hz / 6, kHandMotion_Hz, kMinPredictedRate_Hz);
}

Result<std::unique_ptr<CuttingForceLaw>> CuttingForceLaw::make(const ForceLawSetup& setup) {
  Result<BoneVolume> bone = make_bone_volume(setup.scene, setup.sheets);
  if (!bone) return bone.error().after(setup.scene.asset.string() + ": ");
  const Pose T_device_plate = over_anchor(*setup.sheets.front(), bone->tool);
  const DeviceCoupling coupling = choose_coupling(*bone, setup.scene.force_law, setup.device,
                                                  T_device_plate, setup.rate_Hz, setup.stiffness);
  if (!may_start(coupling))
    return refused(why_not_passive(coupling, lowest_passive_rate_Hz(*bone, setup, T_device_plate)));
  bone->options.coupling = coupling.coupling;
  return std::unique_ptr<CuttingForceLaw>(new CuttingForceLaw(setup, std::move(*bone), coupling));
}

CuttingForceLaw::CuttingForceLaw(const ForceLawSetup& setup, BoneVolume bone,
                                 const DeviceCoupling& coupling)
    : bone_(std::move(bone)),
      state_(make_bone_contact_state(bone_)),
      law_(setup.scene.force_law),
      rate_Hz_(setup.rate_Hz),
      has_unused_damping_(
          std::any_of(setup.sheets.begin(), setup.sheets.end(),
                      [](const Sheet* sheet) { return sheet->tissue.damping_N_s_per_m > 0; })) {
  report_.coupling = coupling;
  report_.force_scale = law_.force_scale;
}

/// Returns the pose that the plate has one tick later if it keeps its velocity. Without a new pose,
/// returns the pose at which the law was evaluated last.
Pose CuttingForceLaw::predicted_pose(const ForceLawInput& input) const noexcept {
  const Pose& plate = input.T_device_plate;
  if (!state_.has_plate) return plate;
  if (!(input.pose_interval_s > 0)) return state_.T_device_evaluated;
  const bool is_steady = input.previous.ago_s > 0;
  const double ticks_ahead =
      1 / (rate_Hz_ * (is_steady ? input.previous.ago_s : input.pose_interval_s));
  const Twist step =
      ticks_ahead *
      displacement(is_steady ? input.previous.T_device_plate : state_.T_device_plate, plate);
  return {plate.p_m + step.head<3>(),
          (from_rotation_vector(step.tail<3>()) * plate.q).normalized()};
}

FaultDetail CuttingForceLaw::update(const ForceLawInput& input, ContactOutput& output) noexcept {
  const Pose evaluated =
      report_.coupling.predicts_pose ? predicted_pose(input) : input.T_device_plate;
  update_bone_contact(bone_, input.sheets, input.T_device_plate, evaluated, input.pose_interval_s,
                      contact_.tracks, state_, output);
  output.T_device_evaluated = evaluated;
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

/// Returns how far the coupling holds the tip of the tool in the tissue away from the tip of the
/// plate's tool.
Eigen::Vector3d CuttingForceLaw::tip_from_plate_m() const noexcept {
  if (!state_.law.has_begun) return Eigen::Vector3d::Zero();
  const Eigen::Vector3d& tip_plate_m = bone_.tool.tip_plate_m;
  return state_.law.T_device_proxy * tip_plate_m - state_.T_device_evaluated * tip_plate_m;
}

void CuttingForceLaw::finish_tick(RecordingRow& row) noexcept {
  const Eigen::Vector3d deflection_m = tip_from_plate_m();
  for (int i = 0; i < 3; ++i)
    row.tool_m[static_cast<std::size_t>(i)] += deflection_m[i];
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
  out += "coupling   " + runtime::describe(report_.coupling, law_) + '\n';
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

SummarySection CuttingForceLaw::summary() const {
  const CuttingCoupling& coupling = report_.coupling.coupling;
  nlohmann::json section = {{"axis", coupling.is_rigid ? "rigid" : "coupled"},
                            {"coupling_N_per_m", nullptr},
                            {"coupling_Nm_per_rad", nullptr},
                            {"device_damping_share", report_.coupling.damping_share},
                            {"inertia_share", report_.coupling.inertia_share},
                            {"pose_is_predicted", report_.coupling.predicts_pose},
                            {"force_scale", report_.force_scale},
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
  }
  return {"cutting", json_text(section)};
}

Result<std::unique_ptr<ForceLaw>> make_cutting_law(const ForceLawSetup& setup) {
  Result<std::unique_ptr<CuttingForceLaw>> law = CuttingForceLaw::make(setup);
  if (!law) return law.error();
  return std::unique_ptr<ForceLaw>(std::move(*law));
}

}  // namespace trocar::runtime
