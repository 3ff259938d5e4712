// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/slice_stack.h"

#include "pipeline/read/label_values.h"

namespace trocar::pipeline {

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

}  // namespace trocar::pipeline
