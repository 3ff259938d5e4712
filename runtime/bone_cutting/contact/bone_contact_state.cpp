// SPDX-License-Identifier: Apache-2.0
// The state of bone_contact.h: how it is made, how it follows twist and feed, how it forgets a hole,
// and how motion ends and may begin again.
#include <algorithm>

#include "runtime/bone_cutting/contact/bone_contact.h"
#include "runtime/bone_cutting/law/holes.h"
#include "runtime/contact/overlap.h"

namespace trocar::runtime {
namespace {

constexpr double kTwist_s = 0.02;
constexpr double kSlabRounding_m = 1e-9;

/// Returns true if uncut material lies under the tool's outline.
bool has_material(const BoneVolume& bone, const Sheet& sheet, const Pose& T_device_plate) noexcept {
  const Eigen::Vector2d at_m = axis_at(bone.tool, T_device_plate, sheet.z_m).head<2>();
  if (!(sheet.field->mean(sheet.transform, at_m, bone.radius_m).share > 0)) return false;
  const LatticeOutline outline =
      outline_on_lattice(bone.tool, T_device_plate, sheet.transform, sheet.z_m);
  return overlap(sheet, bone.tool, outline, {}).coverage > kMinCoverage;
}

}  // namespace

BoneContactState make_bone_contact_state(const BoneVolume& bone) {
  BoneContactState state;
  state.law = make_cutting_state(bone.slabs.size(), kMaxRememberedHoles, bone.layers.size());
  state.slabs = bone.slabs;
  state.sheets.resize(bone.sheets.size());
  for (std::size_t i = 0; i < bone.sheets.size(); ++i)
    state.sheets[i].strength_N = bone.sheets[i].nominal_N;
  state.cuts.reserve(2 * bone.sheets.size());
  state.options = bone.options;
  state.options.layers = bone.layers;
  return state;
}

void follow_twist(const BoneVolume& bone, const Pose& T_device_plate, double interval_s,
                  BoneContactState& state) noexcept {
  const Twist way = displacement(state.T_device_plate, T_device_plate);
  const Eigen::Vector3d inward = T_device_plate.q * -bone.tool.axis_plate;
  const Eigen::Vector3d tip_way =
      T_device_plate * bone.tool.tip_plate_m - state.T_device_plate * bone.tool.tip_plate_m;
  const double share = std::min(1.0, interval_s / kTwist_s);
  state.twist_rad_per_s += share * (way.tail<3>().dot(inward) / interval_s - state.twist_rad_per_s);
  state.feed_m_per_s += share * (tip_way.dot(inward) / interval_s - state.feed_m_per_s);
}

void forget_hole(const BoneVolume& bone, BoneContactState& state) noexcept {
  for (std::size_t i = 0; i < state.sheets.size(); ++i) {
    state.sheets[i].has_cut = state.sheets[i].is_in_hole = false;
    const BoneSheet& sheet = bone.sheets[i];
    for (int k = sheet.first_slab; k < sheet.first_slab + sheet.slabs; ++k)
      state.slabs[k].free = nullptr;
  }
}

void reset_motion(BoneContactState& state) noexcept {
  state.is_released = true;
  for (const SoftLayerState& layer : state.law.layers) {
    if (!(layer.stretch_m > 0)) continue;
    state.retract_to_depth_m =
        state.must_retract ? std::min(state.retract_to_depth_m, layer.cut_m) : layer.cut_m;
    state.must_retract = true;
  }
  state.twist_rad_per_s = state.feed_m_per_s = 0;
  release(state.law);
  state.has_plate = false;
  state.wrench_device.setZero();
  state.result = {};
}

double retract_distance_m(const BoneVolume& bone, std::span<const Sheet* const> sheets,
                          const Pose& T_device_plate, const BoneContactState& state) noexcept {
  if (!state.is_released) return 0;
  const Eigen::Vector3d tip = T_device_plate * bone.tool.tip_plate_m,
                        axis = T_device_plate.q * -bone.tool.axis_plate;
  double free_m = state.must_retract ? state.retract_to_depth_m : -tip.z();
  int empty = -1;  // sheet without uncut material under the tool
  for (std::size_t k = 0; k < bone.slabs.size() && bone.slabs[k].top_m < free_m - kSlabRounding_m;
       ++k) {
    const CuttingSlab& slab = bone.slabs[k];
    const double cut_m = cut_by_any_hole(bone.options, state.law, slab, k, tip, axis);
    if (cut_m >= std::min(slab.bottom_m, free_m) - kSlabRounding_m) continue;
    const int i = bone.sheet_of_slab[k];
    if (i == empty || !has_material(bone, *sheets[static_cast<std::size_t>(i)], T_device_plate)) {
      empty = i;
      continue;
    }
    free_m = std::max(slab.top_m, cut_m);
  }
  return std::max(0.0, -tip.z() - free_m);
}

}  // namespace trocar::runtime
