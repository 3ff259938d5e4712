// SPDX-License-Identifier: GPL-3.0-or-later
// The sentences and numbers of a preview, for its picture and its page. Nothing in them comes from
// names or texts of the input, because such texts may identify the patient.
#pragma once

#include <string>
#include <vector>

#include "pipeline/preview/preview.h"

namespace trocar::pipeline {

/// Kind of the input: "DICOM", "NIfTI", "NRRD" or "images".
std::string input_kind(const SliceStack& stack);

/// Title of the sheet: the kind of input and the number of slices shown.
std::string sheet_title(const SliceStack& stack, const Preview& preview);

/// The options that determine the material, in words.
std::string options_text(const StackOptions& options, const OpenOptions& input, PixelUnit unit);

/// A phrase for sentences: "the slice shown" or "the N slices shown".
std::string slices_shown(const Preview& preview);

/// The sizes of the scan and of `view`, the region shown. If not all slices were inspected, the
/// text says that material beyond the slices shown can be missing.
std::string size_text(const Preview& preview, const Crop& view);

/// The preview's warnings, each once, without file names. A sentence that may contain names or
/// texts of the input is replaced by one that refers to the messages on the terminal.
std::vector<Warning> shown_warnings(const Preview& preview);

/// Says which contours the numbers in Preview::changes include. If the bone is filled, also says
/// how much of a vertebra or a rib is usually covered by filled bone.
std::string changes_text(const Preview& preview);

/// A number with up to `digits` significant digits. If its integer part has more digits, the number
/// is rounded to an integer instead.
std::string number_text(double value, int digits = 4);

}  // namespace trocar::pipeline
