// SPDX-License-Identifier: GPL-3.0-or-later
// Image files as a stack: PNG, TIFF, BMP, JPEG; 8 or 16 bit grey, 24 bit colour.
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "pipeline/slice_stack.h"

namespace trocar::pipeline {
namespace {

// As grey levels 0..255; 16-bit input keeps its fractions.
Result<Image> read_image(const std::filesystem::path& file) {
  cv::Mat raw;
  try {
    raw = cv::imread(file.string(), cv::IMREAD_UNCHANGED);
    if (raw.empty()) return refused(file.string() + ": not a readable image");
    if (raw.cols > kMaxImageSide || raw.rows > kMaxImageSide) {
      return refused(file.string() + ": larger than " + std::to_string(kMaxImageSide) +
                     " pixels a side");
    }
    if (raw.depth() != CV_8U && raw.depth() != CV_16U) {
      return refused(file.string() + ": neither 8 nor 16 bits a channel");
    }
    if (raw.channels() == 3) {
      cv::cvtColor(raw, raw, cv::COLOR_BGR2GRAY);
    } else if (raw.channels() == 4) {
      cv::cvtColor(raw, raw, cv::COLOR_BGRA2GRAY);
    } else if (raw.channels() != 1) {
      return refused(file.string() + ": " + std::to_string(raw.channels()) + " channels");
    }
    raw.convertTo(raw, CV_32F, raw.depth() == CV_16U ? 1.0 / 257.0 : 1.0);
  } catch (const cv::Exception& e) {
    return refused(file.string() + ": " + e.err);
  }
  Image image{raw.cols, raw.rows, {}};
  image.values.reserve(static_cast<std::size_t>(raw.cols) * raw.rows);
  for (int y = 0; y < raw.rows; ++y) {
    const auto* row = raw.ptr<float>(y);
    image.values.insert(image.values.end(), row, row + raw.cols);
  }
  return image;
}

class ImageStack final : public SliceStack {
 public:
  int size() const override { return static_cast<int>(files_.size()); }
  int width() const override { return width_; }
  int height() const override { return height_; }
  Calibration calibration() const override { return Calibration::kGrey; }
  const SlicePlane& plane(int slice) const override { return planes_[slice]; }
  std::string name(int slice) const override { return files_[slice].string(); }
  Result<Image> read(int slice) const override {
    auto image = read_image(files_[slice]);
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
};

}  // namespace

Result<std::unique_ptr<SliceStack>> open_images(std::vector<std::filesystem::path> files,
                                                const OpenOptions& options) {
  if (!options.spacing_mm) {
    return usage("images carry no pixel size: give --spacing X,Y,Z in mm");
  }
  const auto first = read_image(files[0]);
  if (!first) return first.error();
  auto stack = std::make_unique<ImageStack>();
  stack->width_ = first->width;
  stack->height_ = first->height;
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
