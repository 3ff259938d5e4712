// SPDX-License-Identifier: GPL-3.0-or-later
// Recognises CT images, whose values are HU, among DICOM images, and names the modality of others.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"

class DcmItem;

namespace trocar::pipeline {

struct DicomFile;
struct Warning;

/// The kind of a file's images. It is the first of the following kinds whose condition holds:
/// 1. kLocaliser: a value of ImageType contains LOCALIZER, SURVIEW (as REF_SURVIEW does) or SCOUT.
/// 2. kOther: there is a modality other than CT, or a value of ImageType contains MOSAIC or SCREEN
///    SAVE, or the file is a Secondary Capture without a rescale, or a CT whose RescaleType neither
///    begins with HU nor is US (unspecified).
/// 3. kCt: the modality is CT.
/// 4. kUnknown: there is no modality.
/// The modality comes from the attribute Modality. If this attribute is missing or empty, the
/// modality comes from the SOP class, if dicom_headers.cpp lists that class.
struct ImageContent {
  enum class Kind { kCt, kUnknown, kLocaliser, kOther };
  Kind kind = Kind::kUnknown;
  /// The modality, such as "CT"; empty if unknown. If the kind depends on more than the modality,
  /// the reason follows: a value of ImageType ("MR MOSAIC", "CT LOCALIZER"), SECONDARY CAPTURE or
  /// the RescaleType. The name has at most 34 characters: A to Z, 0 to 9, _, spaces, and ? in place
  /// of any other character.
  std::string name;

  /// Is the file a DICOM segmentation (SEG)?
  bool is_segmentation() const { return kind == Kind::kOther && name == "SEG"; }
};

/// The reason why images of kind kLocaliser or kOther are not meshed, and what to do. The text does
/// not name the file.
std::string why_not_ct(const ImageContent& content);

/// Decides whether localisers are images of the scan. The function looks at all files or, if
/// `wanted` is not empty, at those of the series with the UID `wanted`. If there are other DICOM
/// images beside the localisers, the localisers stay kLocaliser, and group_series() leaves them
/// out. If there are only localisers and `any_modality` is set, they become kImages, or kUnusable
/// if they have no frames. Errors: kRefused if there are only localisers and `any_modality` is not
/// set; the message names the first localiser.
Result<void> settle_localisers(std::vector<DicomFile>& files, const std::string& wanted,
                               bool any_modality);

/// Looks at those of `files` that are in `used`, the files of the opened slices. Returns
/// ImageContent::name of the first one whose content is neither kCt nor kUnknown; empty if there is
/// none. Warnings: not_hu if the result is not empty; otherwise no_modality if one is kUnknown.
std::string other_modality(const std::vector<DicomFile>& files,
                           const std::set<std::filesystem::path>& used,
                           std::vector<Warning>& warnings);

// Reads the header of a DICOM file: a single slice, an enhanced (multi-frame) image or a
// segmentation. The result has one entry for each frame. It has no types of DCMTK, the library that
// parses the file.

/// An attribute by which volumes at the same positions in one series differ, such as
/// "AcquisitionNumber".
struct DicomVolumeKey {
  std::string name;
  bool is_of_volume = false;  ///< it tells the time or phase of a whole volume
  bool is_of_slice = false;   ///< it may differ within a volume, too
};
/// The most certain one comes first.
std::vector<DicomVolumeKey> dicom_volume_keys();

/// Fragments of compressed pixels: the index of the first one, from 1 (item 0 is the offset table),
/// and of the one after the last.
using FragmentRange = std::pair<std::uint32_t, std::uint32_t>;

/// One slice: a file, or one frame of a multi-frame file.
struct DicomFrame {
  std::filesystem::path file;
  int frame = 0, frames = 1;  ///< index of the frame, from 0; number of the file's frames
  std::string sop_uid, frame_of_reference;
  /// The centre of the first pixel in LPS, mm, and the unit vectors along a row (u) and along a
  /// column (v), which are at right angles.
  Eigen::Vector3d position, u, v;
  double spacing_u_mm = 0, spacing_v_mm = 0;
  bool has_spacing = false;         ///< true: the file states the spacing
  double thickness_mm = 0;          ///< SliceThickness; 0 if not stated
  double slope = 1, intercept = 0;  ///< HU = slope * stored + intercept
  bool has_rescale = false;         ///< true: the file states slope and intercept
  int segment = 0;                  ///< Segment Number in a segmentation, otherwise 0
  int rows = 0, columns = 0;
  int bits_allocated = 16, bits_stored = 16, high_bit = 15;
  bool is_signed = false;
  /// The lowest and the highest stored value of pixels without data (PixelPaddingValue and
  /// PixelPaddingRangeLimit). std::nullopt if the file states none, and for segmentations and
  /// images of kind ImageContent::Kind::kOther.
  std::optional<std::array<int, 2>> padding;
  std::optional<double> stated_tilt_deg;   ///< the gantry's tilt according to GantryDetectorTilt
  std::vector<std::string> volume_values;  ///< the values of dicom_volume_keys(), empty if missing
  /// Of compressed pixels (frame_fragments()); std::nullopt: the file was read as kHeader.
  std::optional<FragmentRange> fragments;

  double hu(int stored) const { return stored * slope + intercept; }
  /// Does padding have positive HU, so that it would be taken for tissue?
  bool has_dense_padding() const {
    return padding && (hu((*padding)[0]) > 0 || hu((*padding)[1]) > 0);
  }
  /// The file's path and, if the file has several frames, the frame's number from 1.
  std::string name() const;
};

// Do two frames agree, but for rounding in their files?
inline bool same_orientation(const DicomFrame& a, const DicomFrame& b) {
  return (a.u - b.u).norm() <= 1e-3 && (a.v - b.v).norm() <= 1e-3;
}
inline bool same_size(const DicomFrame& a, const DicomFrame& b) {
  return a.rows == b.rows && a.columns == b.columns;
}
inline bool same_spacing(const DicomFrame& a, const DicomFrame& b) {
  return std::abs(a.spacing_u_mm - b.spacing_u_mm) <= 1e-4 &&
         std::abs(a.spacing_v_mm - b.spacing_v_mm) <= 1e-4;
}
inline bool same_frame_of_reference(const DicomFrame& a, const DicomFrame& b) {
  return a.frame_of_reference == b.frame_of_reference;
}

/// A plane with the axes and the spacing of the frame and with the origin `position`. (The origin
/// of the frame's own plane is frame.position.) SlicePlane::z_mm is measured along the frame's own
/// normal, and not along that of the first slice.
SlicePlane plane_of(const DicomFrame& frame, const Eigen::Vector3d& position);

/// Lossy compression that the pixels have gone through, whether or not they are compressed now.
struct LossyCompression {
  std::string method;  ///< such as "JPEG", or "JPEG, then JPEG 2000"; empty if it is not known
  double ratio = 0;    ///< the largest stated ratio, or else that of the file; 0 if it is not known
};

/// The segments of a segmentation (SEG).
struct DicomSegments {
  std::map<int, std::string> names;  ///< key: Segment Number; value: name in UTF-8, may be empty
  double step_mm = 0;                ///< distance between slices; 0 if not stated
  /// MaximumFractionalValue of a FRACTIONAL segmentation; 0 for a BINARY one.
  int max_fraction = 0;
};

struct DicomFile {
  enum class Kind {
    kNotImage,   ///< not DICOM, or DICOM without an image
    kLocaliser,  ///< a scout view, by which a scan is planned
    kImages,
    kSegmentation,  ///< a label map
    kUnusable,
  };
  std::filesystem::path file;
  Kind kind = Kind::kNotImage;
  SeriesInfo series;  ///< series.uid is empty if the file states none
  /// Why the file is unusable, or why a localiser or segmentation is not meshed as a CT: one line
  /// with the file's name. Otherwise empty.
  std::string problem;
  bool is_capture = false;  ///< true: the file, such as a picture of a screen, cannot be a slice
  ImageContent content;
  std::vector<DicomFrame> frames;
  DicomSegments segments;  ///< kSegmentation only
  /// std::nullopt: none is stated, and the transfer syntax is lossless. Only of files that are read
  /// as DicomExtent::kWhole.
  std::optional<LossyCompression> lossy;
  /// If the frames have no positions of their own: how they were placed. Otherwise empty.
  std::string placement;
  bool has_given_step = false;  ///< `placement` is by z of the given spacing
};

/// Replaces the control characters of a text by ?, so that lines of messages and tables are not
/// broken.
std::string without_control(std::string text);

/// Does the file have "DICM" at byte 128, as the DICOM file format requires? The name of the file
/// does not matter.
bool has_dicom_preamble(const std::filesystem::path& file);

/// Should a file in a folder be parsed as DICOM? True if has_dicom_preamble(), or if the file
/// begins with group 2 or 8, as DICOM files without a preamble do.
bool may_be_dicom(const std::filesystem::path& file);

enum class DicomExtent {
  kWhole,   ///< pixels are not decoded, but must be complete
  kHeader,  ///< nothing behind the header is read; the pixels may be missing
};

/// Reads the header of a file. The function never fails: `kind` and `problem` of the result say
/// what is wrong with the file. Frames that state no pixel spacing get x and y of `spacing_mm`; if
/// `spacing_mm` is missing too, the file cannot be used. Frames without positions of their own (no
/// per-frame functional groups) follow the first along its normal, at the distance that the file
/// states (DicomFile::placement). Unless `any_modality` is set, images of kind
/// ImageContent::Kind::kOther that are not segmentations are kUnusable, and localisers have no
/// frames.
DicomFile read_dicom_headers(const std::filesystem::path& file,
                             const std::optional<std::array<double, 3>>& spacing_mm = {},
                             bool any_modality = false, DicomExtent extent = DicomExtent::kWhole);

}  // namespace trocar::pipeline
