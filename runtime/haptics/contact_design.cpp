// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/contact_design.h"

#include <algorithm>

#include "formats/base/text.h"
#include "runtime/device/symmetric_eigenvalues.h"

namespace trocar::runtime {
namespace {

/// A moment is as quiet as the force that has it at this lever.
constexpr double kQuietLever_m = 0.05;

/// Smallest eigenvalue of a block of the damping, which is not negative.
double least_damping(const Eigen::Matrix3d& block) {
  Eigen::Matrix<double, 6, 6> both = Eigen::Matrix<double, 6, 6>::Zero();
  both.topLeftCorner<3, 3>() = both.bottomRightCorner<3, 3>() = block;
  const auto eigenvalues = symmetric_eigenvalues(both);
  return eigenvalues ? std::max(0.0, (*eigenvalues)[0]) : 0;
}

std::string describe(const AxisEstimator& estimator) {
  const std::string filter = std::isfinite(estimator.bandwidth_per_s)
                                 ? text_line("filter %.4g/s", estimator.bandwidth_per_s)
                                 : "no filter";
  return filter + text_line(", lead %.3g ms", 1e3 * estimator.lead_s);
}

}  // namespace

PlateAxes plate_axes(const DeviceSpecification& device, const Pose& T_device_plate) {
  const DeviceReadings readings = device.readings();
  const std::array<double, 3> inertia = device.inertia_kg_m2();
  PlateAxes out{{device.mass_kg(), 0, readings.noise_m, readings.resolution_m},
                {*std::min_element(inertia.begin(), inertia.end()), 0, readings.noise_rad,
                 readings.resolution_rad}};
  if (const auto damping = device.damping(T_device_plate)) {
    out.translation.damping_N_s_per_m = least_damping(damping->topLeftCorner<3, 3>());
    out.rotation.damping_N_s_per_m = least_damping(damping->bottomRightCorner<3, 3>());
  }
  return out;
}

Result<ContactDesign> design_contact(const DeviceSpecification& device, const PlateAxes& axes,
                                     const LoopTiming& timing, const RenderedStiffness& rendered,
                                     const StiffnessLimits& limits, double quiet_N) {
  ContactDesign out{.timing = timing,
                    .axes = axes,
                    .resolution_is_assumed = device.readings().is_assumed,
                    .rendered = rendered,
                    .estimator = {},
                    .device_N_per_m = limits.most_N_per_m(device),
                    .stable_N_per_m = stable_stiffness(timing, axes.translation, limits.margin),
                    .rest_N_per_m = rendered.translation_N_per_m};
  const double K = rendered.translation_N_per_m, K_rotation = rendered.rotation_Nm_per_rad;
  const double stable_Nm_per_rad = stable_stiffness(timing, axes.rotation, limits.margin);
  if (!(out.stable_N_per_m > 0) || !(stable_Nm_per_rad > 0))
    return refused(
        text_line("no contact is stable at %.6g Hz on a device without %s friction whose force is "
                  "%.2g ms old "
                  "on average: raise --rate, shorten the delay, or state the friction (%s)",
                  1 / timing.period_s, out.stable_N_per_m > 0 ? "rotational" : "viscous",
                  1e3 * timing.lag_s(),
                  out.stable_N_per_m > 0 ? "rotation_damping_Nm_s_per_rad" : "damping_N_s_per_m"));
  constexpr double kRounding = 1 + 1e-9;
  const auto translation =
      design_estimator(timing, axes.translation, K, rendered.damping_N_s_per_m, quiet_N);
  if (!translation || !(K <= kRounding * out.stable_N_per_m))
    return refused(text_line(
        "the stiffness of contact is %.4g N/m at %.6g Hz, and the device can hold at most %.4g N/m "
        "(mass %.3g kg, friction %.3g N s/m, delay %.3g ms): lower the tissue's stiffness or the "
        "force scale, raise --rate, or shorten the delay",
        K, 1 / timing.period_s, out.stable_N_per_m, axes.translation.mass_kg,
        axes.translation.damping_N_s_per_m, 1e3 * timing.delay_s));
  const auto rotation =
      design_estimator(timing, axes.rotation, K_rotation, 0, quiet_N * kQuietLever_m);
  if (!rotation || !(K_rotation <= kRounding * stable_Nm_per_rad))
    return refused(text_line(
        "the stiffness of contact against rotation is %.4g Nm/rad at %.6g Hz, and the device can "
        "hold at most %.4g Nm/rad: lower the tissue's stiffness or the force scale, raise --rate, "
        "or shorten the delay",
        K_rotation, 1 / timing.period_s, stable_Nm_per_rad));
  out.estimator = {*translation, *rotation};
  AxisEstimator with_tissue = *translation;
  if (K > 0) with_tissue.lead_s += rendered.damping_N_s_per_m / K;
  out.alternation_m = step_gain(with_tissue, timing.period_s).alternation_m(axes.translation);
  out.alternation_rad = step_gain(*rotation, timing.period_s).alternation_m(axes.rotation);
  return out;
}

std::string describe(const ContactDesign& design) {
  const PlateAxis &axis = design.axes.translation, &turn = design.axes.rotation;
  const double quiet_N_per_m = quiet_stiffness(design.timing, axis, design.stable_N_per_m);
  const double least = std::min({design.device_N_per_m, design.stable_N_per_m, quiet_N_per_m});
  const auto bound = [&](double value) {
    return std::isfinite(value)
               ? text_line("%.4g N/m%s", value, value <= least ? " (the least)" : "")
               : std::string("not stated");
  };
  std::string out = text_line("readings   noise %.3g um, resolution %.3g um%s, delay %.3g ms",
                              1e6 * axis.noise_m, 1e6 * axis.resolution_m,
                              design.resolution_is_assumed ? " (assumed: none is stated)" : "",
                              1e3 * design.timing.delay_s);
  if (turn.noise_m > 0 || turn.resolution_m > 0)
    out += text_line("; rotation: %.2g and %.2g mrad", 1e3 * turn.noise_m, 1e3 * turn.resolution_m);
  out += "\nstiffness  device " + bound(design.device_N_per_m) + ", stable " +
         bound(design.stable_N_per_m) + ", quiet " + bound(quiet_N_per_m) +
         text_line("; rendered at rest %.4g N/m, which alternates by %.2g N\n", design.rest_N_per_m,
                   design.alternation_N());
  return out + "estimator  " + describe(design.estimator.translation) +
         "; rotation: " + describe(design.estimator.rotation) + '\n';
}

std::string contact_warning(const ContactDesign& design) {
  const PlateAxis& axis = design.axes.translation;
  if (!(design.alternation_N() > quiet_N(0))) return {};
  return text_line(
      "a contact at rest alternates by %.2g N, more than %.2g N, with readings of %.3g um "
      "noise and %.3g um resolution%s and %.4g N/m: at most %.4g N/m would be quiet; lower the "
      "stiffness or the force scale, or raise --rate",
      design.alternation_N(), quiet_N(0), 1e6 * axis.noise_m, 1e6 * axis.resolution_m,
      design.resolution_is_assumed ? " (assumed: the description states none)" : "",
      design.rest_N_per_m, quiet_stiffness(design.timing, axis, design.stable_N_per_m));
}

}  // namespace trocar::runtime
