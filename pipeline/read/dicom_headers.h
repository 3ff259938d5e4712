// SPDX-License-Identifier: GPL-3.0-or-later
// What a DICOM file says about its images: one entry a frame, whether the file is a single CT
// slice or an enhanced (multi-frame) CT with its functional groups. Independent of DCMTK.
#pragma once

#include <Eigen/Core>
#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "pipeline/read/modality.h"

namespace trocar::pipeline {

/// One slice: a file, or one frame of a multi-frame file.
struct DicomFrame {
  std::filesystem::path file;
  int frame = 0, frames = 1;  ///< this one, and how many the file has
  std::string sop_uid, frame_of_reference;
  Eigen::Vector3d position, u, v;  ///< LPS mm; u, v unit vectors at right angles
  double spacing_u_mm = 0, spacing_v_mm = 0;
  bool has_spacing = false;         ///< given by the file
  double slope = 1, intercept = 0;  ///< HU = slope * stored + intercept
  bool has_rescale = false;         ///< both given by the file
  int rows = 0, columns = 0;
  int bits_allocated = 16, bits_stored = 16, high_bit = 15;
  bool is_signed = false;

  std::string name() const;  ///< the file, and the frame if there are several
};

struct DicomFile {
  enum class Kind {
    kNotImage,   ///< not DICOM, or DICOM without pixels
    kLocaliser,  ///< a scout view; `problem` says why it is no slice
    kImages,
    kUnusable,  ///< `problem` says why
  };
  std::filesystem::path file;
  Kind kind = Kind::kNotImage;
  std::string series_uid;  ///< empty if missing
  std::string problem;     ///< one line, with the file's name
  bool is_colour = false;  ///< a screen capture, for example: never a slice
  ImageContent content;
  std::vector<DicomFrame> frames;
};

/// Whether the first 132 bytes are those of a DICOM file. Its name does not matter.
bool has_dicom_preamble(const std::filesystem::path& file);

/// Never fails: problems are in the result. `spacing_mm`, if given, is for frames without a
/// pixel spacing of their own. Images of another modality than CT are kUnusable, and localisers
/// have no frames, unless `any_modality`.
DicomFile read_dicom_headers(const std::filesystem::path& file,
                             const std::optional<std::array<double, 3>>& spacing_mm = {},
                             bool any_modality = false);

}  // namespace trocar::pipeline
