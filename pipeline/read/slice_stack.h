// SPDX-License-Identifier: GPL-3.0-or-later
// A scan as a stack of slices, the same for all file formats. Slices are ordered along
// the slice normal. Each keeps its own plane: nothing is resampled.
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

/// One channel, row-major: value(x, y) = values[y * width + x].
struct Image {
  int width = 0, height = 0;
  std::vector<float> values;
  float at(int x, int y) const { return values[static_cast<std::size_t>(y) * width + x]; }
};

/// Something that the user should know but that did not stop the work.
struct Warning {
  std::string code;   ///< stable, for scripts
  std::string where;  ///< files or slices
  std::string sentence;
  std::string shared = {};  ///< for reports, where the sentence could tell whose scan it is
};

/// What a DICOM series says of itself, in UTF-8; empty where it says nothing.
struct SeriesInfo {
  std::string uid;  ///< or, where there is none, what its images have in common
  std::string study_uid, study_date;
  std::optional<int> number;
  std::string description, kernel, modality;
  std::string image_type;  ///< as stored, with backslashes between its values
};

/// What the values of an image are.
enum class PixelUnit {
  kHounsfield,    ///< DICOM after rescale, NIfTI after scl_slope/inter
  kGrey,          ///< image files: 0..255 for any bit depth, or labels
  kUncalibrated,  ///< DICOM that is not CT, after rescale
};

/// Where a slice lies. Plane coordinates are (u, v) in mm: u along a row, v along a
/// column, origin at the centre of pixel (0, 0); u x v is the normal.
struct SlicePlane {
  double spacing_u_mm = 0, spacing_v_mm = 0;
  Eigen::Affine3d T_lps_plane = Eigen::Affine3d::Identity();  ///< orthonormal, mm
  double z_mm = 0;  ///< origin along the first slice's normal
};

struct DicomFile;  // of dicom_headers.h

/// Read-only and safe to read from several threads at once.
class SliceStack {
 public:
  virtual ~SliceStack() = default;
  virtual int size() const = 0;
  virtual int width() const = 0;
  virtual int height() const = 0;
  virtual PixelUnit pixel_unit() const = 0;
  virtual const SlicePlane& plane(int slice) const = 0;
  virtual std::string name(int slice) const = 0;  ///< for messages: file or volume and index
  /// Errors (refused) name file, slice and reason.
  virtual Result<Image> read(int slice) const = 0;
  /// With OpenOptions::unpack_behind: what is wrong with a gzipped volume, also where no slice
  /// needed it, as its checksum.
  virtual Result<void> finish() const { return {}; }
  /// The time that read() has waited so far, in all threads together, for a volume to be unpacked.
  virtual double waited_ms() const { return 0; }

  std::vector<Warning> warnings;                ///< what was noticed on opening
  std::optional<SeriesInfo> series;             ///< that the slices are from; of DICOM input only
  std::optional<VoxelConflict> voxel_conflict;  ///< of a NIfTI
  std::string modality;                         ///< "MR", for example, of kUncalibrated; else empty
  /// All that the slices come from, in order: see digest_input().
  std::vector<std::filesystem::path> files;
  /// What the input itself calls its labels: of a DICOM segmentation, in UTF-8 as it is stored.
  std::map<int, std::string> label_names;
};

/// The anatomical axis that slices are stacked along. Each view has DICOM's usual directions:
/// transverse u left, v back, from the feet up; coronal u left, v down, from front to back;
/// sagittal u back, v down, from left to right.
enum class SliceAxis { kTransverse, kCoronal, kSagittal };

struct OpenOptions {
  std::optional<std::array<double, 3>> spacing_mm;  ///< x, y, z; for input that has none
  std::string series;    ///< UID, number or description, as of named_series()
  std::set<int> labels;  ///< of as_labels: those wanted, which must not overlap; empty: all
  /// The CT that a DICOM segmentation was made on, as it is stored: its slices are the
  /// segmentation's, most of which may have no frame.
  const SliceStack* segmented_ct = nullptr;
  std::optional<SliceAxis> axis;  ///< none: as stored; of a NIfTI volume transverse
  bool as_labels = false;         ///< image levels are labels: as stored, not 0..255; takes SEG
  bool any_modality = false;      ///< take DICOM that is not CT (MR, localisers), as kUncalibrated
  /// Unpack a gzipped volume while its first slices are read; its damage may then be found by
  /// SliceStack::read() and finish().
  bool unpack_behind = false;
};

/// Opens a list of files, or what search_folder() takes of one folder. Errors: (refused) nothing
/// usable, sizes differ, broken file, an axis for DICOM slices that are no regular volume; (usage)
/// spacing missing, an axis for images, a series for input that is not DICOM or one that is not
/// there, several volumes or folders of images. Warnings: those of the readers.
Result<std::unique_ptr<SliceStack>> open_stack(const std::vector<std::filesystem::path>& inputs,
                                               const OpenOptions& options);

/// Whether the file may be part of a scan and must not be overwritten: an image or a NIfTI by its
/// name, or a DICOM file by its first bytes.
bool is_scan_file(const std::filesystem::path& file);

// The readers behind open_stack().
Result<std::unique_ptr<SliceStack>> open_images(std::vector<std::filesystem::path> files,
                                                const OpenOptions& options);
Result<std::unique_ptr<SliceStack>> open_nifti(const std::filesystem::path& file,
                                               const OpenOptions& options);
/// The same without its voxels: read() is refused.
Result<std::unique_ptr<SliceStack>> open_nifti_header(const std::filesystem::path& file,
                                                      const OpenOptions& options);
Result<std::unique_ptr<SliceStack>> open_dicom(const std::vector<std::filesystem::path>& files,
                                               const OpenOptions& options);
Result<std::unique_ptr<SliceStack>> open_dicom(std::vector<DicomFile> headers,
                                               const std::string& where,
                                               const OpenOptions& options);
/// A DICOM segmentation (SEG) as a label map: the labels are its segments' numbers. `file` is of
/// read_dicom_headers(). Slices without a frame are empty. Errors (refused): frames that do not fit
/// each other or options.segmented_ct; on reading, wanted segments that overlap. Warnings:
/// frames_left_out, uneven_spacing.
Result<std::unique_ptr<SliceStack>> open_segmentation(const DicomFile& file,
                                                      const OpenOptions& options);
/// The volume of a stack, sliced along an axis as a NIfTI volume is. Its voxels are written to a
/// temporary file. Errors (refused): its slices are tilted, not evenly spaced, or a single one.
Result<std::unique_ptr<SliceStack>> resliced(std::unique_ptr<SliceStack> stack, SliceAxis axis,
                                             const std::string& where);

inline constexpr int kMaxImageSide = 1 << 15;
/// Slices of more pixels (8192 x 8192) are refused: a header of a few bytes can claim any size.
inline constexpr long kMaxSlicePixels = 1L << 26;

/// BLAKE2b-256 of a file's bytes, hex.
Result<std::string> digest_file(const std::filesystem::path& file);
inline constexpr std::size_t kLeastKeyBytes = 16, kMostKeyBytes = 64;
/// An input's digest with a key of kLeastKeyBytes to kMostKeyBytes: BLAKE2b-256, keyed, of the
/// digests of its files (hex) one after the other, so that files can be digested in parallel. Hex.
std::string digest_input(const std::vector<std::string>& file_digests,
                         const std::vector<std::uint8_t>& key);

}  // namespace trocar::pipeline
