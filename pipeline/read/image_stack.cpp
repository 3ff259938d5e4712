// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/image_stack.h"

#include <algorithm>
#include <charconv>

#include "pipeline/read/image_file.h"
#include "pipeline/read/number_ranges.h"

namespace trocar::pipeline {
namespace {

class ImageStack final : public SliceStack {
 public:
  int size() const override { return static_cast<int>(files_.size()); }
  int width() const override { return first_.width; }
  int height() const override { return first_.height; }
  PixelUnit pixel_unit() const override { return PixelUnit::kGrey; }
  const SlicePlane& plane(int slice) const override { return planes_[slice]; }
  std::string name(int slice) const override { return files_[slice].string(); }
  Result<Image> read(int slice) const override {
    if (slice == 0) return first_;
    auto image = read_image_file(files_[slice], levels_);
    if (image && (image->width != width() || image->height != height())) {
      return refused(name(slice) + ": " + std::to_string(image->width) + " x " +
                     std::to_string(image->height) + " pixels, the first image has " +
                     std::to_string(width()) + " x " + std::to_string(height()));
    }
    return image;
  }

  std::vector<std::filesystem::path> files_;
  std::vector<SlicePlane> planes_;
  Levels levels_ = Levels::kTo255;
  Image first_;  // read on opening
};

// The difference of the numbers in two names; std::nullopt if the names differ in anything else.
std::optional<long> step_between(const std::string& a, const std::string& b) {
  const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
  std::size_t first = 0, last_a = a.size(), last_b = b.size();
  while (first < a.size() && first < b.size() && a[first] == b[first])
    ++first;
  while (first > 0 && is_digit(a[first - 1]))
    --first;
  while (last_a > first && last_b > first && a[last_a - 1] == b[last_b - 1])
    --last_a, --last_b;
  while (last_a < a.size() && is_digit(a[last_a]))
    ++last_a, ++last_b;
  const auto number = [first](const std::string& name, std::size_t last) -> std::optional<long> {
    long value = 0;
    const char* const end = name.data() + last;
    const auto [rest, error] = std::from_chars(name.data() + first, end, value);
    if (error != std::errc() || rest != end || value < 0) return {};
    return value;
  };
  const auto from = number(a, last_a), to = number(b, last_b);
  if (!from || !to) return {};
  return *to - *from;
}

// Warns of numbers that are missing in a sequence of names. Probably a slice is lost, so that all
// later slices are displaced.
void warn_of_missing(const std::vector<std::filesystem::path>& files, double step_mm,
                     std::vector<Warning>& warnings) {
  std::vector<long> steps;
  for (std::size_t i = 1; i < files.size(); ++i) {
    const auto step = step_between(files[i - 1].filename().string(), files[i].filename().string());
    if (!step) return;  // the names are not one sequence
    steps.push_back(*step);
  }
  if (steps.size() < 2) return;
  std::vector<long> sorted = steps;
  std::nth_element(sorted.begin(),
                   sorted.begin() + static_cast<std::ptrdiff_t>((sorted.size() - 1) / 2),
                   sorted.end());
  const long usual = sorted[(sorted.size() - 1) / 2];
  for (std::size_t i = 0; i < steps.size(); ++i) {
    if (steps[i] <= usual) continue;
    warnings.push_back({"missing_slice", files[i].string() + ", " + files[i + 1].string(),
                        "file numbers are missing between them; they are placed " +
                            text_of(step_mm, 4) + " mm apart like all others"});
  }
}

}  // namespace

Result<std::unique_ptr<SliceStack>> open_images(std::vector<std::filesystem::path> files,
                                                const OpenOptions& options) {
  if (!options.spacing_mm) return usage("images carry no pixel size: give --spacing X,Y,Z in mm");
  const Levels levels = options.as_labels ? Levels::kStored : Levels::kTo255;
  auto first = read_image_file(files[0], levels);
  if (!first) return first.error();
  auto stack = std::make_unique<ImageStack>();
  stack->levels_ = levels;
  stack->first_ = std::move(*first);
  stack->files_ = std::move(files);
  const auto [x, y, z] = *options.spacing_mm;
  warn_of_missing(stack->files_, z, stack->warnings);
  for (int i = 0; i < stack->size(); ++i) {
    SlicePlane plane{x, y, Eigen::Affine3d::Identity(), z * i};
    plane.T_lps_plane.translation().z() = plane.z_mm;
    stack->planes_.push_back(plane);
  }
  return std::unique_ptr<SliceStack>(std::move(stack));
}

}  // namespace trocar::pipeline
