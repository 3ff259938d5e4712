// SPDX-License-Identifier: Apache-2.0
#include "runtime/checking/scene_requirements.h"

#include "formats/base/text_line.h"
#include "runtime/force_law/force_law_table.h"
#include "runtime/session/tick_rate.h"

namespace trocar::runtime {
namespace {

/// Describes what the threshold force at the puncture of a sheet demands of the device, if the sheet is touched
/// at this pose.
std::string describe_puncture(const DeviceSpecification& device, const TipForce& tip,
                              const Tool& tool, Pose T_device_plate) {
  T_device_plate.p_m.z() -= tip.threshold_N / tip.stiffness_N_per_m;
  return device.describe_demand("threshold", T_device_plate,
                                wrench_at({0, 0, tip.scale * tip.threshold_N},
                                          T_device_plate * tool.tip_plate_m, T_device_plate));
}

}  // namespace

Result<SceneRequirements> describe_requirements(
    const Scene& scene, const DeviceSpecification& device,
    const std::vector<std::unique_ptr<const Sheet>>& sheets,
    const std::vector<Pose>& T_device_plate, const LoadedBytes& bytes,
    const SessionOptions& options) {
  const double rate_Hz = options.rate_Hz, duration_s = options.duration_s;
  const Tool tool = make_tool(scene.tool);
  // A sheet needs memory for its mesh and for two grids in which triangles are searched. The sheet's replicas
  // (runtime/workers/remesher.h) share it. If holes change the mesh, a replica needs more bytes, which are not counted.
  std::uint64_t kept = 0;
  for (const auto& sheet : sheets)
    kept += sheet->mesh.bytes() + sheet->grid.bytes() + sheet->boundary_grid.bytes();
  SceneRequirements needs;
  std::string& out = needs.scene;
  out += text_line("scene      %s\n", scene.name.c_str());
  out += text_line(
      "asset      %s: %zu of its %zu slices, %.1f of its %.1f kB read, %.1f kB kept in memory\n",
      scene.asset.c_str(), sheets.size(), bytes.asset_slices, static_cast<double>(bytes.read) / 1e3,
      static_cast<double>(bytes.asset) / 1e3, static_cast<double>(kept) / 1e3);
  out += "device     " + std::string(device.name()) + ", " + device.describe_strength() + "\n";
  out += text_line("loop       %.6g Hz for %.6g s: %llu ticks\n", rate_Hz, duration_s,
                   static_cast<unsigned long long>(tick_count(duration_s, rate_Hz)));
  out += text_line("tool       %d corners, %.3g mm from the axis\n", tool.sides,
                   (tool.corner_plate_m[0] - tool.tip_plate_m).norm() * 1e3);

  std::vector<const Sheet*> all;
  all.reserve(sheets.size());
  for (const auto& sheet : sheets)
    all.push_back(sheet.get());
  const auto law = make_force_law({scene, device, all, rate_Hz, {}, options.stiffness});
  if (!law) return law.error();
  out += (*law)->describe();
  needs.stability_warning = (*law)->stability_warning();
  for (std::size_t i = 0; i < sheets.size(); ++i) {
    const Sheet& sheet = *sheets[i];
    const Pose& T = T_device_plate[i];
    const TipForce tip = (*law)->tip_force(i, sheet);
    SliceRequirements slice;
    slice.mesh =
        text_line("slice %-4d at %.4f m: %zu vertices, %zu triangles; %.6g N/m up to %.6g N",
                  sheet.slice_index, sheet.z_m, sheet.mesh.vertices_in_use(),
                  sheet.mesh.triangles_in_use(), tip.stiffness_N_per_m, tip.threshold_N);
    slice.force = describe_puncture(device, tip, tool, T) + (*law)->describe_sheet(i, sheet, T);
    needs.slices.push_back(std::move(slice));
  }
  return needs;
}

}  // namespace trocar::runtime
