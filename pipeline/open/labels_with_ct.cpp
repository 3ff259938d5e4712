// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/open/labels_with_ct.h"

#include <utility>

#include "pipeline/open/open_stack.h"
#include "pipeline/read/same_grid.h"

namespace trocar::pipeline {
namespace {

Result<std::unique_ptr<SliceStack>> open_ct(const std::filesystem::path& ct,
                                            std::optional<SliceAxis> axis) {
  OpenOptions options;
  options.axis = axis;
  auto stack = open_stack({ct}, options);
  if (!stack) {
    // If the input can be opened with these options, it consists of images or is of another
    // modality. The error is then that it has no HU.
    options.spacing_mm = {1, 1, 1};
    options.any_modality = true;
    options.axis.reset();
    const auto other = open_stack({ct}, options);
    if (!other || (*other)->pixel_unit() == PixelUnit::kHounsfield) return stack;
    const std::string& modality = (*other)->modality;
    return refused(ct.string() + ": its values are not HU" +
                   (modality.empty() ? " (images)" : " (" + modality + ")") +
                   "; --hu takes the CT that the labels were made on");
  }
  if ((*stack)->pixel_unit() != PixelUnit::kHounsfield)
    return bug(ct.string() + ": a scan without HU was taken");
  return stack;
}

}  // namespace

Result<LabelsWithCt> open_labels_with_ct(const std::vector<std::filesystem::path>& inputs,
                                         const std::filesystem::path& ct,
                                         const OpenOptions& options) {
  auto stored = open_ct(ct, {});
  if (!stored) return stored.error();
  OpenOptions of_labels = options;
  of_labels.segmented_ct = stored->get();
  auto labels = open_stack(inputs, of_labels);
  if (!labels) return labels.error();
  if (options.axis) {
    stored = open_ct(ct, options.axis);
    if (!stored) return stored.error();
  }
  LabelsWithCt out{std::move(*labels), std::move(*stored)};
  if (const auto differs = grid_difference(*out.labels, *out.ct)) {
    const std::string where =
        differs->slice < 0 ? inputs[0].string() : out.labels->name(differs->slice);
    return refused(where + ": is not on the grid of the CT " + ct.string() + ": its " +
                   differs->what +
                   "; --hu takes the CT that the labels were made on, nothing is resampled");
  }
  out.labels->warnings.insert(out.labels->warnings.end(), out.ct->warnings.begin(),
                              out.ct->warnings.end());
  return out;
}

}  // namespace trocar::pipeline
