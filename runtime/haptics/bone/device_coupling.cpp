// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/bone/device_coupling.h"

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

bool is_passive(const DeviceCoupling& chosen) {
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

}  // namespace trocar::runtime
