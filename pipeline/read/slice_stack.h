// SPDX-License-Identifier: GPL-3.0-or-later
// A scan as a stack of slices, with one interface for all file formats. Slices are ordered along
// the slice normal. Each slice keeps its own plane, because nothing is resampled.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "formats/base/result.h"

namespace trocar::pipeline {

/// The largest label that a voxel can have. 0 is the background.
inline constexpr std::int32_t kMaxLabel = std::numeric_limits<std::int32_t>::max();

/// The labels of an image, row-major as in Image. They are never floats, in which labels above 2^24
/// would merge.
struct LabelImage {
  int width = 0, height = 0;
  std::vector<std::int32_t> values;
  std::size_t not_numbers = 0;  ///< number of pixels that are NaN in the file; their label is 0
  std::size_t rounded = 0;      ///< number of pixels whose stored value is not a whole number
  double largest_rounding = 0;  ///< of these, the largest distance to the label
  std::int32_t at(int x, int y) const { return values[static_cast<std::size_t>(y) * width + x]; }
};

/// A message to the user about something that did not stop the work.
struct Warning {
  std::string code;   ///< stable name, for scripts
  std::string where;  ///< the files or slices concerned
  std::string sentence;
  /// If `sentence` could identify the patient: the text that replaces it in reports. Otherwise
  /// empty.
  std::string shared = {};
};

// NIfTI files state the size of their voxels twice: by the matrix of the sform, which trocar-mesh
// uses, and by pixdim. If the two sizes differ, they give different volumes of the material. For
// example, if a converter did not correct a tilted gantry, the axes of the sform are not at right
// angles, and the volume of a voxel is less than the product of its sides. This header finds such
// differences and warns of them.

/// The two different volumes of a voxel.
struct VoxelConflict {
  std::string reason;  ///< how sform and pixdim disagree
  double sform_mm3 = 0, pixdim_mm3 = 0;
  double pixel_mm2 = 0;  ///< area of a pixel of a slice, according to the sform
};

/// The largest deviation of two columns from a right angle, as a text such as "12 degrees".
std::string shear_text(const Eigen::Matrix3d& columns);

/// Compares the voxel size of the sform with that of pixdim. The columns of `axes_mm` are the steps
/// along the axes of the array according to the sform. `pixdim_mm` has the sides of a voxel
/// according to pixdim. If a side in `pixdim_mm` is not positive and finite, the sform's side
/// replaces it. Each of two conditions makes a conflict:
///  - The two values of a side (the length of the column, and pixdim) differ by more than 1 % of
///    pixdim.
///  - The angle between two columns differs from a right angle by more than 1e-3 rad (0.06
///    degrees).
/// The caller must set `pixel_mm2` of the result.
std::optional<VoxelConflict> voxel_conflict(const Eigen::Matrix3d& axes_mm,
                                            const std::array<double, 3>& pixdim_mm);

/// The volume of the material, computed with the voxel of the sform and with that of pixdim.
struct MaterialVolumes {
  double sform_mm3 = 0, pixdim_mm3 = 0;
};
/// `area_mm2` is the area of the material, summed over all slices.
MaterialVolumes material_volumes(const VoxelConflict& conflict, double area_mm2);

inline constexpr const char* kVoxelVolume = "voxel_volume";  ///< the code of the warning
/// A warning that states the reason of the conflict, the two volumes of a voxel and the two volumes
/// of the material.
Warning voxel_volume_warning(const VoxelConflict& conflict, const MaterialVolumes& material,
                             const std::string& file);

/// The value of pixels without data in a CT.
inline constexpr float kNoData_HU = -1024;

/// An image with one channel, row-major: value(x, y) = values[y * width + x].
struct Image {
  int width = 0, height = 0;
  std::vector<float> values;
  /// Number of pixels that are NaN in the file. Their `values` are kNoData_HU.
  std::size_t not_numbers = 0;
  float at(int x, int y) const { return values[static_cast<std::size_t>(y) * width + x]; }
};

/// The attributes by which a DICOM series describes itself, in UTF-8. Missing ones are empty.
struct SeriesInfo {
  /// If no file states a UID, it is made of frame of reference, size and orientation.
  std::string uid;
  std::string study_uid, study_date;
  std::optional<int> number;
  std::string description, kernel, modality;
  std::string image_type;  ///< the values of ImageType with backslashes between them
};

/// The unit of an image's values.
enum class PixelUnit {
  /// HU: CT in DICOM after the rescale, and NIfTI after scl_slope and scl_inter. Label maps in
  /// NIfTI files and DICOM segmentations have this unit, too, although labels are no HU.
  kHounsfield,
  kGrey,          ///< grey levels of 0..255 of image files, or labels in them
  kUncalibrated,  ///< values of DICOM that is not CT, after the rescale; never NIfTI files
};

/// The plane of a slice. Plane coordinates are (u, v) in mm: u along a row, v along a column, with
/// the origin at the centre of pixel (0, 0); u x v is the normal.
struct SlicePlane {
  double spacing_u_mm = 0, spacing_v_mm = 0;
  /// Maps plane coordinates to LPS (DICOM's patient coordinates), mm. Its axes are orthonormal.
  Eigen::Affine3d T_lps_plane = Eigen::Affine3d::Identity();
  double z_mm = 0;  ///< position of pixel (0, 0) along the first slice's normal
};

/// A stack of slices. It is read-only, and several threads may read it at the same time.
class SliceStack {
 public:
  virtual ~SliceStack() = default;
  virtual int size() const = 0;
  virtual int width() const = 0;
  virtual int height() const = 0;
  virtual PixelUnit pixel_unit() const = 0;
  virtual const SlicePlane& plane(int slice) const = 0;
  /// The name of a slice in messages: its file, or the volume and the index.
  virtual std::string name(int slice) const = 0;
  /// Reads the pixels of a slice. Errors: kRefused; the message names file, slice and reason.
  virtual Result<Image> read(int slice) const = 0;
  /// Reads a slice of a label map that was opened with OpenOptions::as_labels. Errors: those of
  /// read(), and those of to_labels().
  virtual Result<LabelImage> read_labels(int slice) const;
  /// Waits until a volume that was opened with OpenOptions::unpack_behind is completely unpacked.
  /// Errors: kRefused if the volume is damaged, even in a part that no slice needed, such as the
  /// checksum.
  virtual Result<void> finish() const { return {}; }
  /// The time that read() has waited so far for a volume to be unpacked, added up over all threads.
  virtual double waited_ms() const { return 0; }

  std::vector<Warning> warnings;                ///< the reader's warnings
  std::optional<SeriesInfo> series;             ///< the series of the slices; DICOM input only
  std::optional<VoxelConflict> voxel_conflict;  ///< set if a NIfTI states two voxel sizes
  std::string modality;  ///< such as "MR" if pixel_unit() is kUncalibrated; otherwise empty
  /// The files that the slices come from, in the order in which digest_input() gets their digests.
  std::vector<std::filesystem::path> files;
  /// The names that a DICOM segmentation gives its labels, as stored, in UTF-8; empty for other
  /// input.
  std::map<int, std::string> label_names;
};

/// The anatomical axis along which slices are stacked. It determines the directions of u and v in
/// the patient and the order of the slices, as is usual in DICOM:
///  - Axial: u points to the left, v to the back; slices are ordered from the feet to the head.
///  - Coronal: u points to the left, v to the feet; slices are ordered from front to back.
///  - Sagittal: u points to the back, v to the feet; slices are ordered from left to right.
enum class SliceAxis { kAxial, kCoronal, kSagittal };

struct OpenOptions {
  /// Pixel sizes x and y, and slice distance z, for input that states none.
  std::optional<std::array<double, 3>> spacing_mm;
  std::string series;  ///< wanted series (see named_series()); empty: choose_series() chooses
  /// The wanted labels if as_labels is set; empty: all. Wanted segments of a DICOM segmentation
  /// must not overlap.
  std::set<int> labels;
  /// The CT from which a DICOM segmentation was made, opened along its stored axis. If it is given,
  /// the opened segmentation has all slices of the CT, even those for which the file has no frame.
  const SliceStack* segmented_ct = nullptr;
  std::optional<SliceAxis> axis;  ///< std::nullopt: the stored axis, or axial for a NIfTI volume
  std::optional<int> volume;      ///< index of the wanted volume; required if there are several
  bool as_labels = false;         ///< read grey levels as stored, and accept DICOM segmentations;
                                  ///< slices are read by SliceStack::read_labels()
  bool any_modality = false;      ///< accept DICOM that is not CT (MR, localisers) as kUncalibrated
  bool completeness_unknown = false;  ///< nobody has said how many images the scan has
  /// Unpack a gzipped volume on another thread, while its first slices are already read. If the
  /// volume is damaged, SliceStack::read() and finish() return the error.
  bool unpack_behind = false;
};

/// The name of the input in messages: its file, or the folder of its files. Empty if the stack has
/// no files.
std::string input_name(const SliceStack& stack);

/// Largest width or height of a slice in pixels. Larger slices are refused.
inline constexpr int kMaxImageSide = 1 << 15;
/// Slices with more pixels than this (8192 x 8192) are refused, because a header of a few bytes can
/// claim any size.
inline constexpr long kMaxSlicePixels = 1L << 26;

// The distances between slices, and the shift from one slice to the next.

struct StackShape {
  std::vector<double> gaps_mm;  ///< distances along the normal, from each slice to the next
  double step_mm = 0;           ///< median of gaps_mm; 0 for a single slice
  double shift_mm = 0;  ///< largest in-plane shift of a slice's origin relative to the slice before
  /// Gantry tilt: the angle between the normal and the line from the first position to the last.
  double tilt_deg = 0;

  bool is_tilted() const { return shift_mm > 0.01; }
  bool is_uneven(std::size_t gap) const;  ///< true if the gap differs from step_mm by more than 1 %
  std::optional<std::size_t> first_uneven() const;
};

/// `positions` are the origins of the slices in mm, and `normal` is a unit vector. Precondition:
/// the positions ascend along the normal.
StackShape stack_shape(const std::vector<Eigen::Vector3d>& positions,
                       const Eigen::Vector3d& normal);

StackShape stack_shape(const SliceStack& stack);

/// Checks that each slice from `first` to `last` is parallel to slice `first`, has the same pixel
/// spacing, and lies above the slice before it. Errors: kRefused if a slice fails one of these
/// checks; the message ends with `advice`.
Result<void> check_parallel(const SliceStack& stack, int first, int last,
                            const std::string& advice);

// Compares the voxel grids of two stacks, for example of a label map and its CT. The two are used
// together only if the grids are equal, because nothing is resampled.

/// Two grids are equal if no pixel is shifted by more than this fraction of a voxel's side from one
/// to the other. Differences in spacing, orientation and origin all shift pixels.
inline constexpr double kSameVoxel = 1e-3;

/// Describes how `plane` differs from `other`, for example "spacing is 1 x 1 mm, not 1 x 1.5".
/// Returns std::nullopt if there is no difference above kSameVoxel. Both planes have width x height
/// pixels. `step_mm` is the distance between slices.
std::optional<std::string> plane_difference(const SlicePlane& plane, const SlicePlane& other,
                                            int width, int height, double step_mm);

/// The distance from a slice to the next slice. For the last slice, it is the distance from the
/// slice before. If there is only one slice, it is the smaller of that slice's pixel spacings.
double slice_step_mm(const SliceStack& stack, int slice);

/// The first difference between the grids of two stacks.
struct GridDifference {
  /// Index of the first slice that differs. It is -1 if the difference seems to concern all slices,
  /// that is, if the sizes, the slice distances or the first slices of the two stacks differ.
  int slice = -1;
  std::string what;  ///< description, such as "size is ... voxels, not ..."
};
/// Returns no value if the grids are equal.
std::optional<GridDifference> grid_difference(const SliceStack& stack, const SliceStack& other);

// Makes labels of the values that a label map stores.

/// A value that is no whole number is rounded if it is at most this far from one. Programs that
/// scale or resample label maps store such values (3.0000457).
inline constexpr double kMaxLabelRounding = 1e-3;

/// The labels of `values`, the row-major pixels of an image. NaN is background. `name` is the
/// slice's name in error messages. Errors: kRefused if a value is negative, above kMaxLabel, or
/// farther than kMaxLabelRounding from a whole number; the message names the first such voxel and
/// its value.
Result<LabelImage> to_labels(std::span<const double> values, int width, int height,
                             const std::string& name);

/// The same for an image of floats. Values equal to `background` are background, too. Errors: also
/// kRefused for a value above 2^24, beyond which whole numbers have merged in floats.
Result<LabelImage> to_labels(const Image& image, const std::string& name,
                             std::optional<float> background = {});

}  // namespace trocar::pipeline
