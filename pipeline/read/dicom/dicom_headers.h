// SPDX-License-Identifier: GPL-3.0-or-later
// The headers of a DICOM file's images, with one entry for each frame, for single CT slices and for
// enhanced (multi-frame) CT with its functional groups. Independent of DCMTK.
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
  int frame = 0, frames = 1;  ///< its index, and the number of frames in the file
  std::string sop_uid, frame_of_reference;
  Eigen::Vector3d position, u, v;  ///< LPS mm; u, v unit vectors at right angles
  double spacing_u_mm = 0, spacing_v_mm = 0;
  bool has_spacing = false;         ///< whether the file states it
  double slope = 1, intercept = 0;  ///< HU = slope * stored + intercept
  bool has_rescale = false;         ///< whether the file states both
  int segment = 0;                  ///< Segment Number in a segmentation; else 0
  int rows = 0, columns = 0;
  int bits_allocated = 16, bits_stored = 16, high_bit = 15;
  bool is_signed = false;
  /// CT only: PixelPaddingValue and PixelPaddingRangeLimit (equal if there is no range) as stored
  /// values, ascending. Pixels within them have no data.
  std::optional<std::array<int, 2>> padding;
  std::optional<double> stated_tilt_deg;  ///< GantryDetectorTilt

  double hu(int stored) const { return stored * slope + intercept; }
  /// Whether padding has positive HU, so that it would be taken for tissue.
  bool has_dense_padding() const {
    return padding && (hu((*padding)[0]) > 0 || hu((*padding)[1]) > 0);
  }
  std::string name() const;  ///< the file, and the frame if there are several
};

/// The plane of the frame moved to a position, with z_mm along its own normal.
SlicePlane plane_of(const DicomFrame& frame, const Eigen::Vector3d& position);

/// The segments of a segmentation (SEG).
struct DicomSegments {
  std::map<int, std::string> names;  ///< name of each Segment Number, in UTF-8; may be empty
  double step_mm = 0;                ///< distance between slices; 0: not stated
  int max_fraction = 0;              ///< MaximumFractionalValue if FRACTIONAL; 0 if BINARY
};

struct DicomFile {
  enum class Kind {
    kNotImage,   ///< not DICOM, or DICOM without pixels
    kLocaliser,  ///< a scout view; `problem` says why it is no slice
    kImages,
    kSegmentation,  ///< a label map; `problem` says why it is no slice
    kUnusable,      ///< `problem` says why
  };
  std::filesystem::path file;
  Kind kind = Kind::kNotImage;
  SeriesInfo series;        ///< its UID is empty if missing
  std::string problem;      ///< one line, with the file's name
  bool is_capture = false;  ///< whether it is, for example, a picture of a screen and never a slice
  ImageContent content;
  std::vector<DicomFrame> frames;
  DicomSegments segments;  ///< kSegmentation only
};

/// The text with ? for its control characters, so that messages and tables keep their lines.
std::string without_control(std::string text);

/// Whether the first 132 bytes are those of a DICOM file. Its name does not matter.
bool has_dicom_preamble(const std::filesystem::path& file);

/// Whether a file in a folder is worth parsing: it has the preamble, or, without one, begins with
/// the tag of a group that DICOM files begin with.
bool may_be_dicom(const std::filesystem::path& file);

enum class DicomExtent {
  kWhole,   ///< pixels are not decoded, but must be complete
  kHeader,  ///< nothing behind the header is read, and may be missing
};

/// Never fails: problems are in the result. `spacing_mm`, if given, applies to frames without a
/// pixel spacing of their own. Images of another modality than CT are kUnusable, and localisers
/// have no frames, unless `any_modality`; segmentations are kSegmentation either way.
DicomFile read_dicom_headers(const std::filesystem::path& file,
                             const std::optional<std::array<double, 3>>& spacing_mm = {},
                             bool any_modality = false, DicomExtent extent = DicomExtent::kWhole);

}  // namespace trocar::pipeline
