// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/mesh_scan.h"

#include <memory>
#include <string>
#include <utility>

#include "formats/asset/deidentification.h"
#include "formats/base/text_pattern.h"
#include "pipeline/open/open_stack.h"

namespace trocar::pipeline {
namespace {

using nlohmann::json;

// The kernel for the report, or an empty text if it could identify the patient: DICOM allows any
// text of 16 characters, and a scanner's kernels, such as "Br40d\\3", have no ^ and no four digits
// in a row.
std::string shared_kernel(const std::string& kernel) {
  constexpr std::size_t kMaxCharacters = 16;
  const bool is_plain = kernel.size() <= kMaxCharacters && matches(kernel, "[A-Za-z0-9_ .+/-]*") &&
                        !matches(kernel, ".*[0-9]{4}.*");
  return is_plain ? kernel : "";
}

}  // namespace

Result<LabelsWithCt> open_scan(const Arguments& a) {
  if (!a.hu.empty()) return open_labels_with_ct(a.inputs, a.hu, a.open);
  auto stack = open_stack(a.inputs, a.open);
  if (!stack) return stack.error();
  return LabelsWithCt{std::move(*stack), nullptr};
}

std::vector<std::filesystem::path> files_read(const Arguments& a, const LabelsWithCt& scan) {
  std::vector<std::filesystem::path> out = scan.labels->files;
  if (scan.ct != nullptr) out.insert(out.end(), scan.ct->files.begin(), scan.ct->files.end());
  if (!a.names.empty()) out.emplace_back(a.names);
  if (!a.input_key.empty()) out.push_back(a.input_key);
  if (!a.stack.solid.mask_file.empty()) out.emplace_back(a.stack.solid.mask_file);
  return out;
}

Result<void> check_input(const Arguments& a, SliceStack& stack) {
  if (a.open.completeness_unknown) {
    stack.warnings.push_back({"completeness_unknown", "--completeness-unknown",
                              "nobody has said how many images the scan has; some may be missing"});
  }
  if (stack.pixel_unit() == PixelUnit::kHounsfield || a.labels || a.equalize) return {};
  if (stack.pixel_unit() == PixelUnit::kUncalibrated) {
    if (!a.threshold || !a.preset.empty()) {
      const auto sentence = [](const std::string& modality) {
        return "its default and the presets are meant in HU; values of " + modality +
               " need one of their own";
      };
      stack.warnings.push_back({"default_threshold", "--threshold", sentence(stack.modality),
                                sentence(shared_modality(stack.modality))});
    }
    return {};
  }
  if (!a.preset.empty()) {
    return usage("--preset " + a.preset +
                 " is for HU, which images do not carry: give --equalize "
                 "LEVEL, or --threshold with a grey level of 0..255");
  }
  if (!a.threshold) {
    return usage(
        "images carry no HU: give --equalize LEVEL, or --threshold with a grey level of 0..255");
  }
  if (!(*a.threshold >= 0 && *a.threshold <= 255)) {
    stack.warnings.push_back({"threshold_out_of_range", "--threshold",
                              "images have grey levels of 0..255, whatever their depth; with this "
                              "threshold all of a slice is material, or nothing"});
  }
  return {};
}

json series_for_report(const SeriesInfo& series) {
  return {{"number", series.number ? json(*series.number) : json()},
          {"kernel", shared_kernel(series.kernel)},
          {"modality", is_modality(series.modality) ? series.modality : ""}};
}

}  // namespace trocar::pipeline
