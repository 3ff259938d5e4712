// SPDX-License-Identifier: GPL-3.0-or-later
// NIfTI-1 and -2, plain or gzipped, any axis order. Slices run along the array axis that is
// nearest to the patient's z axis; rows and columns are turned so that u points to the patient's
// left and v to the back (LPS), by reading in another order, never by resampling.
#include <nifti2_io.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "pipeline/slice_stack.h"

namespace trocar::pipeline {
namespace {

struct ImageDeleter {
  void operator()(nifti_image* image) const { nifti_image_free(image); }
};
using NiftiImage = std::unique_ptr<nifti_image, ImageDeleter>;

class NiftiStack final : public SliceStack {
 public:
  int size() const override { return static_cast<int>(planes_.size()); }
  int width() const override { return static_cast<int>(n_[0]); }
  int height() const override { return static_cast<int>(n_[1]); }
  Calibration calibration() const override { return Calibration::kHounsfield; }
  const SlicePlane& plane(int slice) const override { return planes_[slice]; }
  std::string name(int slice) const override { return file_ + " slice " + std::to_string(slice); }
  Result<Image> read(int slice) const override {
    Image out{width(), height(), {}};
    out.values.resize(static_cast<std::size_t>(n_[0] * n_[1]));
    const bool ok = dispatch([&](auto zero) {
      using T = decltype(zero);
      const auto* data = static_cast<const char*>(image_->data);
      float* to = out.values.data();
      for (std::int64_t y = 0; y < n_[1]; ++y) {
        for (std::int64_t x = 0; x < n_[0]; ++x) {
          const std::int64_t at = first_ + x * stride_[0] + y * stride_[1] + slice * stride_[2];
          T value;
          std::memcpy(&value, data + at * static_cast<std::int64_t>(sizeof(T)), sizeof(T));
          *to++ = static_cast<float>(static_cast<double>(value) * slope_ + intercept_);
        }
      }
    });
    if (!ok) return bug("NIfTI type not dispatched");
    for (float v : out.values) {
      if (!std::isfinite(v)) return refused(name(slice) + ": a voxel that is not a finite number");
    }
    return out;
  }

  // Calls f with a zero of the voxel type; false if it is not a scalar we read.
  template <typename F>
  bool dispatch(F f) const {
    switch (image_->datatype) {
      case NIFTI_TYPE_UINT8:
        return f(std::uint8_t{}), true;
      case NIFTI_TYPE_INT8:
        return f(std::int8_t{}), true;
      case NIFTI_TYPE_UINT16:
        return f(std::uint16_t{}), true;
      case NIFTI_TYPE_INT16:
        return f(std::int16_t{}), true;
      case NIFTI_TYPE_UINT32:
        return f(std::uint32_t{}), true;
      case NIFTI_TYPE_INT32:
        return f(std::int32_t{}), true;
      case NIFTI_TYPE_UINT64:
        return f(std::uint64_t{}), true;
      case NIFTI_TYPE_INT64:
        return f(std::int64_t{}), true;
      case NIFTI_TYPE_FLOAT32:
        return f(float{}), true;
      case NIFTI_TYPE_FLOAT64:
        return f(double{}), true;
      default:
        return false;
    }
  }

  std::string file_;
  NiftiImage image_;
  std::array<std::int64_t, 3> n_{}, stride_{};  // of u, v and the slice axis, in voxels
  std::int64_t first_ = 0;                      // voxel at u = v = slice = 0
  double slope_ = 1, intercept_ = 0;
  std::vector<SlicePlane> planes_;
};

// The voxel-to-patient matrix in LPS mm, by sform, qform or, failing both, the voxel sizes.
Eigen::Matrix4d voxel_to_lps(const nifti_image& image, const std::string& file,
                             std::vector<Warning>& warnings) {
  Eigen::Matrix4d T = Eigen::Matrix4d::Identity();
  const auto take = [&T](const nifti_dmat44& m) {
    for (int r = 0; r < 4; ++r) {
      for (int c = 0; c < 4; ++c)
        T(r, c) = m.m[r][c];
    }
  };
  if (image.sform_code > 0) {
    take(image.sto_xyz);
  } else if (image.qform_code > 0) {
    take(image.qto_xyz);
  } else {
    T.diagonal() << image.dx, image.dy, image.dz, 1.0;
    warnings.push_back({"no_orientation", file,
                        "the file has neither sform nor qform; array axes are taken as right, "
                        "anterior, superior"});
  }
  return Eigen::Vector4d(-1, -1, 1, 1).asDiagonal() * T;  // RAS -> LPS
}

}  // namespace

Result<std::unique_ptr<SliceStack>> open_nifti(const std::filesystem::path& path,
                                               const OpenOptions& options) {
  nifti_set_debug_level(0);
  const std::string file = path.string();
  auto stack = std::make_unique<NiftiStack>();
  stack->file_ = file;
  stack->image_.reset(nifti_image_read(file.c_str(), 0));
  if (!stack->image_) return refused(file + ": not a readable NIfTI file");
  nifti_image& image = *stack->image_;
  const std::array<std::int64_t, 3> n = {image.nx, image.ny, image.nz};
  for (std::int64_t side : n) {
    if (side < 1 || side > kMaxImageSide)
      return refused(file + ": a side of " + std::to_string(side) + " voxels");
  }
  if (image.nt > 1 || image.nu > 1 || image.nv > 1 || image.nw > 1) {
    return refused(file + ": more than three dimensions");
  }
  if (!stack->dispatch([](auto) {})) {
    return refused(file + ": voxel type " + std::string(nifti_datatype_string(image.datatype)) +
                   " is not a scalar");
  }
  Eigen::Matrix4d T = voxel_to_lps(image, file, stack->warnings);
  if (!T.allFinite()) return refused(file + ": its affine is not finite");
  if (options.spacing_mm) {
    stack->warnings.push_back(
        {"spacing_ignored", file,
         "--spacing is for input without a voxel size; the file's own is used"});
  }

  // Array axes for u, v, slices: the assignment whose unit vectors lie closest to x, y, z.
  std::array<int, 3> axis{0, 1, 2}, best = axis;
  double best_score = -1;
  do {
    double score = 0;
    for (int k = 0; k < 3; ++k)
      score += std::abs(T.col(axis[k]).head<3>().normalized()[k]);
    if (score > best_score) best_score = score, best = axis;
  } while (std::next_permutation(axis.begin(), axis.end()));

  const std::array<std::int64_t, 3> voxel_stride = {1, n[0], n[0] * n[1]};
  Eigen::Vector3d origin = T.col(3).head<3>();
  std::array<Eigen::Vector3d, 3> direction;
  for (int k = 0; k < 3; ++k) {
    const int a = best[k];
    stack->n_[k] = n[a];
    direction[k] = T.col(a).head<3>();
    stack->stride_[k] = voxel_stride[a];
    if (direction[k][k] < 0) {  // read this axis backwards
      origin += direction[k] * static_cast<double>(n[a] - 1);
      stack->first_ += voxel_stride[a] * (n[a] - 1);
      direction[k] = -direction[k];
      stack->stride_[k] = -voxel_stride[a];
    }
  }
  const double su = direction[0].norm(), sv = direction[1].norm();
  if (!(su > 1e-6 && sv > 1e-6 && direction[2].norm() > 1e-6))
    return refused(file + ": a voxel size of zero");
  const Eigen::Vector3d u = direction[0] / su;
  Eigen::Vector3d v = direction[1] / sv;
  if (std::abs(u.dot(v)) > 1e-3)
    return refused(file + ": its rows and columns are not at right angles");
  v = (v - u * u.dot(v)).normalized();
  const Eigen::Vector3d normal = u.cross(v);
  if (normal.dot(direction[2]) <= 0) return refused(file + ": its affine has no volume");

  for (std::int64_t i = 0; i < stack->n_[2]; ++i) {
    SlicePlane plane{su, sv, Eigen::Affine3d::Identity(), 0};
    plane.T_lps_plane.linear() << u, v, normal;
    plane.T_lps_plane.translation() = origin + direction[2] * static_cast<double>(i);
    plane.z_mm = normal.dot(plane.T_lps_plane.translation());
    stack->planes_.push_back(plane);
  }
  if (image.scl_slope != 0 && std::isfinite(image.scl_slope) && std::isfinite(image.scl_inter)) {
    stack->slope_ = image.scl_slope;
    stack->intercept_ = image.scl_inter;
  }
  if (nifti_image_load(&image) != 0 || image.data == nullptr) {
    return refused(file + ": the voxels cannot be read (truncated?)");
  }
  return std::unique_ptr<SliceStack>(std::move(stack));
}

}  // namespace trocar::pipeline
