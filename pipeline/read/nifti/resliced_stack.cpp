// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/nifti/resliced_stack.h"

#include <nifti1.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "pipeline/read/nifti/nifti_header.h"
#include "pipeline/read/nifti/nifti_stack.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/read/stack_shape.h"
#include "pipeline/read/volume_file.h"

namespace trocar::pipeline {
namespace {

// Errors (refused): the slices do not form a regular volume.
Result<void> check_volume(const SliceStack& stack, const std::string& where) {
  const std::string reason = ": --axis needs a volume of evenly spaced slices without tilt; ";
  if (stack.size() < 2) return refused(where + reason + "it has one slice");
  const StackShape shape = stack_shape(stack);
  char text[64];
  if (shape.is_tilted()) {
    std::snprintf(text, sizeof text, "these are tilted by %.1f degrees", shape.tilt_deg);
    return refused(where + reason + text);
  }
  if (const auto at = shape.first_uneven()) {
    std::snprintf(text, sizeof text, " are %.4g mm apart, others %.4g mm", shape.gaps_mm[*at],
                  shape.step_mm);
    return refused(where + reason + stack.name(static_cast<int>(*at)) + " and " +
                   stack.name(static_cast<int>(*at) + 1) + text);
  }
  return {};
}

}  // namespace

Result<std::unique_ptr<SliceStack>> resliced(std::unique_ptr<SliceStack> stack, SliceAxis axis,
                                             const std::string& where, bool as_labels) {
  if (auto ok = check_volume(*stack, where); !ok) return ok.error();
  const SlicePlane &first = stack->plane(0), &last = stack->plane(stack->size() - 1);
  const Eigen::Vector3d from = first.T_lps_plane.translation();
  NiftiHeader header;
  header.n = {stack->width(), stack->height(), stack->size()};
  header.datatype = as_labels ? NIFTI_TYPE_INT32 : NIFTI_TYPE_FLOAT32;
  header.bytes_per_voxel = 4;
  header.T_lps_voxel.col(0).head<3>() = first.T_lps_plane.linear().col(0) * first.spacing_u_mm;
  header.T_lps_voxel.col(1).head<3>() = first.T_lps_plane.linear().col(1) * first.spacing_v_mm;
  header.T_lps_voxel.col(2).head<3>() =
      (last.T_lps_plane.translation() - from) / (stack->size() - 1);
  header.T_lps_voxel.col(3).head<3>() = from;
  auto voxels = VolumeFile::temporary(where);
  if (!voxels) return voxels.error();
  const auto append = [&](const auto& image) -> Result<void> {
    if (!image) return image.error();
    const auto* bytes = reinterpret_cast<const char*>(image->values.data());
    return voxels->append({bytes, image->values.size() * 4}, where);
  };
  for (int k = 0; k < stack->size(); ++k) {
    if (auto ok = as_labels ? append(stack->read_labels(k)) : append(stack->read(k)); !ok)
      return ok.error();
  }
  auto out = open_voxels(where, header, std::move(*voxels), axis);
  if (!out) return out.error();
  (*out)->warnings = std::move(stack->warnings);
  (*out)->series = std::move(stack->series);
  (*out)->modality = std::move(stack->modality);
  (*out)->files = std::move(stack->files);
  (*out)->label_names = std::move(stack->label_names);
  return out;
}

}  // namespace trocar::pipeline
