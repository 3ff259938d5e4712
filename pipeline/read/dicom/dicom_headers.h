// SPDX-License-Identifier: GPL-3.0-or-later
// Reads the headers of the images in a DICOM file: single CT slices, and enhanced (multi-frame) CT
// with its functional groups. The result has one entry for each frame and no types of DCMTK.
// Tests: tests/pipeline/read/dicom/dicom_variants_test.py
#pragma once

#include <Eigen/Core>
#include <array>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "pipeline/read/dicom/modality.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// One slice: a file, or one frame of a multi-frame file.
struct DicomFrame {
  std::filesystem::path file;
  int frame = 0, frames = 1;  ///< the index of the frame, and the number of frames in the file
  std::string sop_uid, frame_of_reference;
  Eigen::Vector3d position, u, v;  ///< LPS mm; u, v unit vectors at right angles
  double spacing_u_mm = 0, spacing_v_mm = 0;
  bool has_spacing = false;         ///< true: the file states the spacing
  double slope = 1, intercept = 0;  ///< HU = slope * stored + intercept
  bool has_rescale = false;         ///< true: the file states slope and intercept
  int segment = 0;                  ///< Segment Number in a segmentation, otherwise 0
  int rows = 0, columns = 0;
  int bits_allocated = 16, bits_stored = 16, high_bit = 15;
  bool is_signed = false;
  /// CT only: PixelPaddingValue and PixelPaddingRangeLimit as stored values, ascending; they are
  /// equal if the file states no range. Pixels with values in this range have no data.
  std::optional<std::array<int, 2>> padding;
  std::optional<double> stated_tilt_deg;  ///< GantryDetectorTilt

  double hu(int stored) const { return stored * slope + intercept; }
  /// Does padding have positive HU, so that it would be taken for tissue?
  bool has_dense_padding() const {
    return padding && (hu((*padding)[0]) > 0 || hu((*padding)[1]) > 0);
  }
  std::string name() const;  ///< the file's name, and the frame's number if there are several
};

/// The plane of the frame, moved so that its origin is `position`. Its z_mm is measured along the
/// frame's own normal.
SlicePlane plane_of(const DicomFrame& frame, const Eigen::Vector3d& position);

/// The segments of a segmentation (SEG).
struct DicomSegments {
  std::map<int, std::string> names;  ///< key: Segment Number; value: name in UTF-8, may be empty
  double step_mm = 0;                ///< distance between slices; 0 if not stated
  int max_fraction = 0;              ///< MaximumFractionalValue if FRACTIONAL; 0 if BINARY
};

struct DicomFile {
  enum class Kind {
    kNotImage,   ///< not DICOM, or DICOM without pixels
    kLocaliser,  ///< a scout view; `problem` states why it is not a slice
    kImages,
    kSegmentation,  ///< a label map; `problem` states why it is not a slice
    kUnusable,      ///< `problem` states the reason
  };
  std::filesystem::path file;
  Kind kind = Kind::kNotImage;
  SeriesInfo series;        ///< its UID is empty if the file states none
  std::string problem;      ///< one line, with the file's name
  bool is_capture = false;  ///< true: it can never be a slice, like a picture of a screen
  ImageContent content;
  std::vector<DicomFrame> frames;
  DicomSegments segments;  ///< kSegmentation only
};

/// Replaces the control characters of a text by ?, so that lines of messages and tables are not
/// broken.
std::string without_control(std::string text);

/// Are the first 132 bytes of the file those of a DICOM file? The name of the file does not matter.
bool has_dicom_preamble(const std::filesystem::path& file);

/// Should a file in a folder be parsed? It should if it has the preamble, or if its first bytes are
/// the tag of a group with which DICOM files without a preamble begin.
bool may_be_dicom(const std::filesystem::path& file);

enum class DicomExtent {
  kWhole,   ///< pixels are not decoded, but must be complete
  kHeader,  ///< data behind the header are not read, and may be missing
};

/// Reads the headers of a file. The function never fails: the result states the problem. If
/// `spacing_mm` is given, it applies to frames that state no pixel spacing. Unless `any_modality`
/// is set, images of another modality than CT are kUnusable, and localisers have no frames.
/// Segmentations are kSegmentation in any case.
DicomFile read_dicom_headers(const std::filesystem::path& file,
                             const std::optional<std::array<double, 3>>& spacing_mm = {},
                             bool any_modality = false, DicomExtent extent = DicomExtent::kWhole);

}  // namespace trocar::pipeline
