// SPDX-License-Identifier: GPL-3.0-or-later
// Image files as a stack, in the order in which they are given.
#include "pipeline/image_file.h"
#include "pipeline/slice_stack.h"

namespace trocar::pipeline {
namespace {

class ImageStack final : public SliceStack {
 public:
  int size() const override { return static_cast<int>(files_.size()); }
  int width() const override { return width_; }
  int height() const override { return height_; }
  Calibration calibration() const override { return Calibration::kGrey; }
  const SlicePlane& plane(int slice) const override { return planes_[slice]; }
  std::string name(int slice) const override { return files_[slice].string(); }
  Result<Image> read(int slice) const override {
    if (slice == 0) return first_;
    auto image = read_image_file(files_[slice], levels_);
    if (image && (image->width != width_ || image->height != height_)) {
      return refused(name(slice) + ": " + std::to_string(image->width) + " x " +
                     std::to_string(image->height) + " pixels, the first image has " +
                     std::to_string(width_) + " x " + std::to_string(height_));
    }
    return image;
  }

  std::vector<std::filesystem::path> files_;
  std::vector<SlicePlane> planes_;
  int width_ = 0, height_ = 0;
  Levels levels_ = Levels::kTo255;
  Image first_;  ///< read on opening
};

}  // namespace

Result<std::unique_ptr<SliceStack>> open_images(std::vector<std::filesystem::path> files,
                                                const OpenOptions& options) {
  if (!options.spacing_mm) {
    return usage("images carry no pixel size: give --spacing X,Y,Z in mm");
  }
  const Levels levels = options.as_labels ? Levels::kStored : Levels::kTo255;
  auto first = read_image_file(files[0], levels);
  if (!first) return first.error();
  auto stack = std::make_unique<ImageStack>();
  stack->levels_ = levels;
  stack->width_ = first->width;
  stack->height_ = first->height;
  stack->first_ = std::move(*first);
  stack->files_ = std::move(files);
  const auto [x, y, z] = *options.spacing_mm;
  for (int i = 0; i < stack->size(); ++i) {
    SlicePlane plane{x, y, Eigen::Affine3d::Identity(), z * i};
    plane.T_lps_plane.translation().z() = plane.z_mm;
    stack->planes_.push_back(plane);
  }
  return std::unique_ptr<SliceStack>(std::move(stack));
}

}  // namespace trocar::pipeline
