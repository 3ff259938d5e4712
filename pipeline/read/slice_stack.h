// SPDX-License-Identifier: GPL-3.0-or-later
// A scan as a stack of slices, with one interface for all file formats. Slices are ordered along
// the slice normal. Each keeps its own plane: nothing is resampled.
// Tests: tests/pipeline/read/readers_test.cpp
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/voxel_volume.h"

namespace trocar::pipeline {

/// The value of pixels without data in a CT.
inline constexpr float kNoData_HU = -1024;

/// One channel, row-major: value(x, y) = values[y * width + x].
struct Image {
  int width = 0, height = 0;
  std::vector<float> values;
  std::size_t not_numbers = 0;  ///< pixels that were not numbers (NaN) and are background here
  float at(int x, int y) const { return values[static_cast<std::size_t>(y) * width + x]; }
};

/// A message to the user about something that did not stop the work.
struct Warning {
  std::string code;   ///< stable, for scripts
  std::string where;  ///< files or slices
  std::string sentence;
  std::string shared = {};  ///< replaces the sentence in reports if it could identify the patient
};

/// The description of a DICOM series by its own attributes, in UTF-8; missing ones are empty.
struct SeriesInfo {
  std::string uid;  ///< a substitute if the series has none: what its images have in common
  std::string study_uid, study_date;
  std::optional<int> number;
  std::string description, kernel, modality;
  std::string image_type;  ///< the stored values with backslashes between them
};

/// The unit of an image's values.
enum class PixelUnit {
  kHounsfield,    ///< DICOM after rescale, NIfTI after scl_slope/inter
  kGrey,          ///< image files: 0..255 for any bit depth, or labels
  kUncalibrated,  ///< DICOM that is not CT, after rescale
};

/// The plane of a slice. Plane coordinates are (u, v) in mm: u along a row, v along a column, with
/// the origin at the centre of pixel (0, 0); u x v is the normal.
struct SlicePlane {
  double spacing_u_mm = 0, spacing_v_mm = 0;
  Eigen::Affine3d T_lps_plane = Eigen::Affine3d::Identity();  ///< orthonormal, mm
  double z_mm = 0;  ///< coordinate of the origin along the first slice's normal
};

/// Read-only and safe to read from several threads at once.
class SliceStack {
 public:
  virtual ~SliceStack() = default;
  virtual int size() const = 0;
  virtual int width() const = 0;
  virtual int height() const = 0;
  virtual PixelUnit pixel_unit() const = 0;
  virtual const SlicePlane& plane(int slice) const = 0;
  virtual std::string name(int slice) const = 0;  ///< file, or volume and index, for messages
  /// Errors (refused) name file, slice and reason.
  virtual Result<Image> read(int slice) const = 0;
  /// Waits until a gzipped volume is unpacked (OpenOptions::unpack_behind). Errors (refused): it is
  /// damaged, also in parts that no slice needed, such as its checksum.
  virtual Result<void> finish() const { return {}; }
  /// The total time of all threads that read() has waited so far for a volume to be unpacked.
  virtual double waited_ms() const { return 0; }

  std::vector<Warning> warnings;                ///< the reader's warnings
  std::optional<SeriesInfo> series;             ///< the series of the slices; DICOM input only
  std::optional<VoxelConflict> voxel_conflict;  ///< NIfTI input only
  std::string modality;  ///< such as "MR" if pixel_unit() is kUncalibrated; else empty
  /// The files that the slices come from, in order; digest_input() identifies them.
  std::vector<std::filesystem::path> files;
  /// The names that a DICOM segmentation gives its labels, in UTF-8 as stored; else empty.
  std::map<int, std::string> label_names;
};

/// The anatomical axis along which slices are stacked. The directions are those that are usual in
/// DICOM. Axial: u left, v back, slices from the feet up. Coronal: u left, v down, slices from
/// front to back. Sagittal: u back, v down, slices from left to right.
enum class SliceAxis { kAxial, kCoronal, kSagittal };

struct OpenOptions {
  std::optional<std::array<double, 3>> spacing_mm;  ///< x, y, z; used for input without a spacing
  std::string series;    ///< UID, number or description; see named_series()
  std::set<int> labels;  ///< wanted labels, with as_labels; they must not overlap; empty: all
  /// The CT that a DICOM segmentation was made on, along its stored axis. The segmentation gets its
  /// slices, most of which may have no frame.
  const SliceStack* segmented_ct = nullptr;
  std::optional<SliceAxis> axis;  ///< no value: the stored axis; for a NIfTI volume axial
  std::optional<int> volume;      ///< volume of a NIfTI that holds several, counted from 0
  bool as_labels = false;         ///< read image levels as stored, and take DICOM segmentations
  bool any_modality = false;      ///< take DICOM that is not CT (MR, localisers) as kUncalibrated
  /// Unpack a gzipped volume while its first slices are read. Damage is then reported by
  /// SliceStack::read() and finish().
  bool unpack_behind = false;
};

/// The name of the input in messages: its file, or the folder of its files; empty if there are
/// none.
std::string input_name(const SliceStack& stack);

inline constexpr int kMaxImageSide = 1 << 15;
/// Slices of more pixels (8192 x 8192) are refused: a header of a few bytes can claim any size.
inline constexpr long kMaxSlicePixels = 1L << 26;

}  // namespace trocar::pipeline
