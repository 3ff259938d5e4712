// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/slice_stack.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "pipeline/read/number_ranges.h"

namespace trocar::pipeline {
namespace {

std::string short_text(double value) {
  return text_of(value, 4);
}

std::string sides_text(const std::array<double, 3>& mm) {
  return short_text(mm[0]) + " x " + short_text(mm[1]) + " x " + short_text(mm[2]) + " mm";
}

// The largest cosine of an angle between two columns.
double largest_cosine(const Eigen::Matrix3d& columns) {
  double out = 0;
  for (int k = 0; k < 3; ++k) {
    const Eigen::Vector3d a = columns.col(k).normalized(),
                          b = columns.col((k + 1) % 3).normalized();
    out = std::max(out, std::abs(a.dot(b)));
  }
  return std::min(out, 1.0);
}

std::string point_text(const Eigen::Vector3d& p) {
  // The text is appended, because g++ 12 warns of an overlap (-Wrestrict) for a literal + a
  // temporary string here.
  std::string out = "(";
  out += text_of(p.x()) + ", " + text_of(p.y()) + ", " + text_of(p.z()) + ")";
  return out;
}

// The largest component of the difference, in units of the voxel's sides.
double in_voxels(const Eigen::Vector3d& apart, const SlicePlane& plane, double step_mm) {
  const Eigen::Vector3d along = plane.T_lps_plane.linear().transpose() * apart;
  // The sides of a voxel along u, v and the normal.
  const Eigen::Vector3d sides(plane.spacing_u_mm, plane.spacing_v_mm, step_mm);
  return along.cwiseQuotient(sides).cwiseAbs().maxCoeff();
}

std::string size_text(const SliceStack& stack) {
  return std::to_string(stack.width()) + " x " + std::to_string(stack.height()) + " x " +
         std::to_string(stack.size());
}

// In floats, whole numbers above it merge.
constexpr double kMaxOfFloats = 1 << 24;

std::string value_text(double value) {
  constexpr double kExact = 9007199254740992;  // 2^53
  if (std::rint(value) == value && std::abs(value) <= kExact)
    return std::to_string(static_cast<std::int64_t>(value));
  return text_of(value, 15);
}

template <typename T>
Result<LabelImage> labels_of(std::span<const T> values, int width, int height,
                             const std::string& name, double max, std::optional<T> background) {
  LabelImage out{width, height, {}};
  out.values.resize(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    const auto value = static_cast<double>(values[i]), whole = std::rint(value);
    const double rounding = std::abs(value - whole);
    if (std::isnan(value) || values[i] == background) {
      out.not_numbers += std::isnan(value) ? 1 : 0;
    } else if (rounding <= kMaxLabelRounding && whole >= 0 && whole <= max) {
      out.values[i] = static_cast<std::int32_t>(whole);
      if (rounding == 0) continue;
      ++out.rounded;
      out.largest_rounding = std::max(out.largest_rounding, rounding);
    } else {
      const auto across = static_cast<std::size_t>(width);
      return refused(name + ": voxel " + std::to_string(i % across) + ", " +
                     std::to_string(i / across) + " is " + value_text(value) +
                     ", which is no label, a whole number from 0 to " + value_text(max) +
                     "; if this is no label map, try it without --labels");
    }
  }
  return out;
}

}  // namespace

std::string shear_text(const Eigen::Matrix3d& columns) {
  return short_text(std::asin(largest_cosine(columns)) * 180 / std::numbers::pi) + " degrees";
}

std::optional<VoxelConflict> voxel_conflict(const Eigen::Matrix3d& axes_mm,
                                            const std::array<double, 3>& pixdim_mm) {
  // Sides that differ by exactly 1 % agree, because of the margin for the rounding of 32-bit
  // floats.
  constexpr double kMaxRelative = 0.01 + 1e-6, kMaxCosine = 1e-3;
  std::array<double, 3> by_sform{}, by_pixdim{};
  bool differs = false;
  VoxelConflict out{{}, std::abs(axes_mm.determinant()), 1, 0};
  for (int k = 0; k < 3; ++k) {
    by_sform[k] = axes_mm.col(k).norm();
    const bool is_stated = std::isfinite(pixdim_mm[k]) && pixdim_mm[k] > 0;
    by_pixdim[k] = is_stated ? pixdim_mm[k] : by_sform[k];
    differs |= std::abs(by_sform[k] - by_pixdim[k]) > kMaxRelative * by_pixdim[k];
    out.pixdim_mm3 *= by_pixdim[k];
  }
  if (largest_cosine(axes_mm) > kMaxCosine)
    out.reason = "its sform shears by " + shear_text(axes_mm);
  if (differs)
    out.reason += (out.reason.empty() ? "its" : ", and its") + std::string(" spacing is ") +
                  sides_text(by_sform) + " by sform but " + sides_text(by_pixdim) + " by pixdim";
  if (out.reason.empty()) return {};
  return out;
}

MaterialVolumes material_volumes(const VoxelConflict& conflict, double area_mm2) {
  const double voxels = area_mm2 / conflict.pixel_mm2;
  return {voxels * conflict.sform_mm3, voxels * conflict.pixdim_mm3};
}

Warning voxel_volume_warning(const VoxelConflict& conflict, const MaterialVolumes& material,
                             const std::string& file) {
  return {kVoxelVolume, file,
          conflict.reason + "; the sform is used; a voxel has " + short_text(conflict.sform_mm3) +
              " mm^3 by sform, " + short_text(conflict.pixdim_mm3) +
              " by pixdim; the material has " + short_text(material.sform_mm3) +
              " mm^3 by sform, " + short_text(material.pixdim_mm3) + " by pixdim"};
}

Result<LabelImage> SliceStack::read_labels(int slice) const {
  const auto image = read(slice);
  if (!image) return image.error();
  return to_labels(*image, name(slice));
}

std::string input_name(const SliceStack& stack) {
  if (stack.files.empty()) return {};
  const std::filesystem::path& file = stack.files[0];
  const std::filesystem::path folder = file.has_parent_path() ? file.parent_path() : ".";
  return (stack.files.size() == 1 ? file : folder).string();
}

bool StackShape::is_uneven(std::size_t gap) const {
  return std::abs(gaps_mm[gap] - step_mm) > 0.01 * step_mm;
}

std::optional<std::size_t> StackShape::first_uneven() const {
  for (std::size_t i = 0; i < gaps_mm.size(); ++i) {
    if (is_uneven(i)) return i;
  }
  return {};
}

StackShape stack_shape(const std::vector<Eigen::Vector3d>& positions,
                       const Eigen::Vector3d& normal) {
  StackShape out;
  if (positions.size() < 2) return out;
  for (std::size_t i = 1; i < positions.size(); ++i) {
    const Eigen::Vector3d step = positions[i] - positions[i - 1];
    out.gaps_mm.push_back(normal.dot(step));
    out.shift_mm = std::max(out.shift_mm, (step - normal * normal.dot(step)).norm());
  }
  std::vector<double> sorted = out.gaps_mm;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  out.step_mm = *middle;
  const Eigen::Vector3d way = positions.back() - positions.front();
  const double along = normal.dot(way);
  out.tilt_deg = std::atan2((way - normal * along).norm(), along) * 180 / std::numbers::pi;
  return out;
}

StackShape stack_shape(const SliceStack& stack) {
  std::vector<Eigen::Vector3d> positions(static_cast<std::size_t>(stack.size()));
  for (int k = 0; k < stack.size(); ++k)
    positions[static_cast<std::size_t>(k)] = stack.plane(k).T_lps_plane.translation();
  return stack_shape(positions, stack.plane(0).T_lps_plane.linear().col(2));
}

Result<void> check_parallel(const SliceStack& stack, int first, int last,
                            const std::string& advice) {
  const SlicePlane& a = stack.plane(first);
  for (int k = first + 1; k <= last; ++k) {
    const SlicePlane& b = stack.plane(k);
    const Eigen::Matrix3d turn = a.T_lps_plane.linear().transpose() * b.T_lps_plane.linear();
    if (!turn.isApprox(Eigen::Matrix3d::Identity(), 1e-3) ||
        std::abs(b.spacing_u_mm / a.spacing_u_mm - 1) > 1e-3 ||
        std::abs(b.spacing_v_mm / a.spacing_v_mm - 1) > 1e-3) {
      return refused(stack.name(k) + ": is not parallel to the first slice or has other pixels; " +
                     advice);
    }
    if (!(b.z_mm > stack.plane(k - 1).z_mm))
      return refused(stack.name(k) + ": lies at the height of the slice before it; " + advice);
  }
  return {};
}

std::optional<std::string> plane_difference(const SlicePlane& plane, const SlicePlane& other,
                                            int width, int height, double step_mm) {
  // A difference of the spacing adds up over a whole row or column.
  const double across = std::max(width, height) - 1;
  const auto spacing_differs = [across](double a, double b) {
    return !(std::abs(a - b) * across <= kSameVoxel * b);
  };
  if (spacing_differs(plane.spacing_u_mm, other.spacing_u_mm) ||
      spacing_differs(plane.spacing_v_mm, other.spacing_v_mm)) {
    return "spacing is " + text_of(plane.spacing_u_mm) + " x " + text_of(plane.spacing_v_mm) +
           " mm, not " + text_of(other.spacing_u_mm) + " x " + text_of(other.spacing_v_mm);
  }
  for (const int axis : {0, 1}) {
    const Eigen::Vector3d a = plane.T_lps_plane.linear().col(axis),
                          b = other.T_lps_plane.linear().col(axis);
    const double length_mm =
        axis == 0 ? (width - 1) * plane.spacing_u_mm : (height - 1) * plane.spacing_v_mm;
    if (!(in_voxels((a - b) * length_mm, other, step_mm) <= kSameVoxel)) {
      return std::string("orientation differs: its ") + (axis == 0 ? "rows" : "columns") +
             " run along " + point_text(a) + ", not " + point_text(b);
    }
  }
  const Eigen::Vector3d a = plane.T_lps_plane.translation(), b = other.T_lps_plane.translation();
  if (!(in_voxels(a - b, other, step_mm) <= kSameVoxel))
    return "origin is " + point_text(a) + " mm, not " + point_text(b);
  return {};
}

double slice_step_mm(const SliceStack& stack, int slice) {
  if (stack.size() < 2) {
    const SlicePlane& only = stack.plane(0);
    return std::min(only.spacing_u_mm, only.spacing_v_mm);
  }
  const int from = std::min(slice, stack.size() - 2);
  return stack.plane(from + 1).z_mm - stack.plane(from).z_mm;
}

std::optional<GridDifference> grid_difference(const SliceStack& stack, const SliceStack& other) {
  if (stack.width() != other.width() || stack.height() != other.height() ||
      stack.size() != other.size())
    return GridDifference{-1, "size is " + size_text(stack) + " voxels, not " + size_text(other)};
  for (int k = 0; k < stack.size(); ++k) {
    const SlicePlane &a = stack.plane(k), &b = other.plane(k);
    auto what = plane_difference(a, b, other.width(), other.height(), slice_step_mm(other, k));
    if (!what) continue;
    const double step = slice_step_mm(stack, k), wanted = slice_step_mm(other, k);
    if (k > 0 && std::abs(step - wanted) > kSameVoxel * wanted)
      return GridDifference{-1,
                            "slices are " + text_of(step) + " mm apart, not " + text_of(wanted)};
    return GridDifference{k == 0 ? -1 : k, std::move(*what)};
  }
  return {};
}

Result<LabelImage> to_labels(std::span<const double> values, int width, int height,
                             const std::string& name) {
  return labels_of(values, width, height, name, kMaxLabel, std::optional<double>());
}

Result<LabelImage> to_labels(const Image& image, const std::string& name,
                             std::optional<float> background) {
  auto out =
      labels_of(std::span(image.values), image.width, image.height, name, kMaxOfFloats, background);
  if (out) out->not_numbers += image.not_numbers;
  return out;
}

}  // namespace trocar::pipeline
