// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/nrrd.h"

#include <fcntl.h>
#include <nifti1.h>
#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <map>

#include "pipeline/read/file_names.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;

// Reads headers of NRRD files (teem.sourceforge.net/nrrd/format.html): lines of text, of which
// every number is checked before anything is allocated. The data follow the header, or are in a
// file of their own in the same folder (.nhdr).

struct NrrdHeader {
  // The array. `data_start` and `data_end` are offsets in the unpacked data, which begin at
  // `data_at` of the data's file; `volumes` is the size of a fourth axis.
  NiftiHeader array;
  std::int64_t data_at = 0;
  bool is_gzip = false;
  std::string data_file;  // name of the data's file in the header's folder; empty: the same file
  bool at_end = false;    // the data are the last bytes of their file (byte skip -1)
  // The names of labels that 3D Slicer stores with a segmentation.
  std::map<int, std::string> label_names;
};

constexpr int kMaxDimension = 16;
constexpr double kMissing = std::numeric_limits<double>::quiet_NaN();

struct Type {
  int datatype, bytes;
};

// The names of types, as the format lists them.
const std::map<std::string, Type, std::less<>>& types() {
  static const auto all = [] {
    std::map<std::string, Type, std::less<>> out;
    const auto add = [&out](Type type, std::initializer_list<const char*> names) {
      for (const char* name : names)
        out.emplace(name, type);
    };
    add({NIFTI_TYPE_INT8, 1}, {"signed char", "int8", "int8_t"});
    add({NIFTI_TYPE_UINT8, 1}, {"uchar", "unsigned char", "uint8", "uint8_t"});
    add({NIFTI_TYPE_INT16, 2},
        {"short", "short int", "signed short", "signed short int", "int16", "int16_t"});
    add({NIFTI_TYPE_UINT16, 2},
        {"ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"});
    add({NIFTI_TYPE_INT32, 4}, {"int", "signed int", "int32", "int32_t"});
    add({NIFTI_TYPE_UINT32, 4}, {"uint", "unsigned int", "uint32", "uint32_t"});
    add({NIFTI_TYPE_INT64, 8}, {"longlong", "long long", "long long int", "signed long long",
                                "signed long long int", "int64", "int64_t"});
    add({NIFTI_TYPE_UINT64, 8},
        {"ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"});
    add({NIFTI_TYPE_FLOAT32, 4}, {"float"});
    add({NIFTI_TYPE_FLOAT64, 8}, {"double"});
    return out;
  }();
  return all;
}

// The names of fields that have two, by their other name.
constexpr std::array<std::pair<std::string_view, std::string_view>, 6> kOtherNames{
    {{"datafile", "data file"},
     {"lineskip", "line skip"},
     {"byteskip", "byte skip"},
     {"oldmin", "old min"},
     {"oldmax", "old max"},
     {"centerings", "centers"}}};

std::string_view trimmed(std::string_view text) {
  const auto is_blank = [](char c) { return c == ' ' || c == '\t' || c == '\r'; };
  while (!text.empty() && is_blank(text.front()))
    text.remove_prefix(1);
  while (!text.empty() && is_blank(text.back()))
    text.remove_suffix(1);
  return text;
}

template <typename Number>
std::optional<Number> number_of(std::string_view text) {
  text = trimmed(text);
  if (text.starts_with('+')) text.remove_prefix(1);
  Number out{};
  const char* const end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, out);
  if (error != std::errc() || rest != end) return {};
  return out;
}

std::vector<std::string_view> words_of(std::string_view text) {
  std::vector<std::string_view> out;
  while (!(text = trimmed(text)).empty()) {
    const std::size_t end = std::min(text.find_first_of(" \t"), text.size());
    out.push_back(text.substr(0, end));
    text.remove_prefix(end);
  }
  return out;
}

// Vectors such as "(1,0,0)"; "none" is an empty value. No value if the text is wrong.
using Vectors = std::vector<std::optional<Eigen::Vector3d>>;
std::optional<Vectors> vectors_of(std::string_view text) {
  Vectors out;
  while (!(text = trimmed(text)).empty()) {
    if (text.starts_with("none")) {
      out.emplace_back();
      text.remove_prefix(4);
      continue;
    }
    const std::size_t end = text.find(')');
    if (text.front() != '(' || end == std::string_view::npos) return {};
    std::string_view inner = text.substr(1, end - 1);
    text.remove_prefix(end + 1);
    Eigen::Vector3d& vector = out.emplace_back(Eigen::Vector3d::Zero()).value();
    for (int k = 0; k < 3; ++k) {
      const std::size_t comma = k < 2 ? inner.find(',') : inner.size();
      if (comma == std::string_view::npos) return {};
      const auto value = number_of<double>(inner.substr(0, comma));
      if (!value || !(std::abs(*value) < 1e7)) return {};
      vector[k] = *value;
      inner.remove_prefix(std::min(comma + 1, inner.size()));
    }
  }
  return out;
}

// The lines of a header.
class Fields {
 public:
  // Errors: (refused) no header, no end of it, a line that is neither field nor comment, a field
  // that is given twice.
  static Result<Fields> of(std::string_view head, const std::string& file) {
    Fields out(file);
    if (!head.starts_with("NRRD000") || head.size() < 9 || head[7] < '1' || head[7] > '5')
      return out.wrong("not a NRRD file of version 1 to 5");
    bool is_first = true;
    for (std::size_t at = 0; at < head.size(); is_first = false) {
      const std::size_t end = head.find('\n', at);
      const std::string_view line = trimmed(head.substr(at, std::min(end, head.size()) - at));
      at = end == std::string_view::npos ? head.size() : end + 1;
      out.size = at;
      if (line.empty()) return out;
      if (is_first || line.front() == '#') continue;
      if (auto ok = out.add(line); !ok) return ok.error();
    }
    out.has_end = false;
    return out;
  }

  Error wrong(const std::string& what) const { return refused(file_ + ": " + what); }
  Error wrong_field(std::string_view name) const {
    constexpr std::size_t kMax = 60;
    return wrong("its field \"" + std::string(name) +
                 "\" is not valid: " + std::string(get(name).value_or("").substr(0, kMax)));
  }
  std::optional<std::string_view> get(std::string_view name) const {
    const auto found = fields_.find(name);
    if (found == fields_.end()) return {};
    return found->second;
  }
  /// One number for each axis. NaN stands for a number that the file does not state.
  Result<std::vector<double>> numbers(std::string_view name, std::size_t count) const {
    std::vector<double> out;
    for (const std::string_view word : words_of(get(name).value_or(""))) {
      const auto value = number_of<double>(word);
      if (!value) return wrong_field(name);
      out.push_back(*value);
    }
    if (out.size() != count) return wrong_field(name);
    return out;
  }

  std::size_t size = 0;  /// bytes of the header
  bool has_end = true;   /// a blank line ends it
  std::map<std::string, std::string_view, std::less<>> keys;

 private:
  explicit Fields(std::string file) : file_(std::move(file)) {}

  Result<void> add(std::string_view line) {
    const std::size_t colon = line.find(':');
    if (colon == std::string_view::npos || colon == 0) {
      constexpr std::size_t kMax = 60;
      return wrong("its header has the line " + std::string(line.substr(0, kMax)));
    }
    if (line.substr(colon).starts_with(":=")) {
      keys.emplace(line.substr(0, colon), line.substr(colon + 2));
      return {};
    }
    std::string name = lower(std::string(line.substr(0, colon)));
    for (const auto& [other, usual] : kOtherNames)
      if (name == other) name = usual;
    if (!fields_.emplace(name, trimmed(line.substr(colon + 1))).second)
      return wrong("its header states \"" + name + "\" twice");
    return {};
  }

  std::string file_;
  std::map<std::string, std::string_view, std::less<>> fields_;
};

Result<std::vector<std::int64_t>> sizes_of(const Fields& fields) {
  const auto dimension = number_of<int>(fields.get("dimension").value_or(""));
  if (!dimension || *dimension < 1 || *dimension > kMaxDimension)
    return fields.wrong_field("dimension");
  std::vector<std::int64_t> out;
  for (const std::string_view word : words_of(fields.get("sizes").value_or(""))) {
    const auto size = number_of<std::int64_t>(word);
    if (!size || *size < 1 || *size > kMaxImageSide) return fields.wrong_field("sizes");
    out.push_back(*size);
  }
  if (out.size() != static_cast<std::size_t>(*dimension)) return fields.wrong_field("sizes");
  return out;
}

// The axes of the array in LPS, and its origin.
struct Frame {
  std::vector<std::optional<Eigen::Vector3d>> axes;  // no value: not spatial
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  bool has_size = true, is_oriented = false;
};

// Which axes are spatial by their kinds: all, if there are none.
Result<std::vector<bool>> spatial_kinds(const Fields& fields, std::size_t dimension) {
  std::vector<bool> out;
  for (const std::string_view word : words_of(fields.get("kinds").value_or(""))) {
    const std::string kind = lower(std::string(word));
    out.push_back(kind == "domain" || kind == "space" || kind == "???" || kind == "none");
  }
  if (out.empty()) out.assign(dimension, true);
  if (out.size() != dimension) return fields.wrong_field("kinds");
  return out;
}

Result<Frame> frame_of(const Fields& fields, std::size_t dimension) {
  Frame out;
  Eigen::Vector3d to_lps(1, 1, 1);
  if (const auto space = fields.get("space")) {
    const std::string name = lower(std::string(*space));
    out.is_oriented = true;
    if (name == "ras" || name == "right-anterior-superior")
      to_lps = {-1, -1, 1};
    else if (name == "las" || name == "left-anterior-superior")
      to_lps = {1, -1, 1};
    else if (name != "lps" && name != "left-posterior-superior")
      return fields.wrong("space " + name.substr(0, 60) + " is neither LPS, RAS nor LAS");
  } else if (const auto space_dimension = fields.get("space dimension");
             space_dimension && number_of<int>(*space_dimension) != 3) {
    return fields.wrong_field("space dimension");
  }
  if (const auto units = fields.get("space units"))
    for (const std::string_view unit : words_of(*units))
      if (unit != "\"mm\"" && unit != "mm" && unit != "\"\"")
        return fields.wrong_field("space units");
  const auto kinds = spatial_kinds(fields, dimension);
  if (!kinds) return kinds.error();
  if (const auto directions = fields.get("space directions")) {
    auto axes = vectors_of(*directions);
    if (!axes || axes->size() != dimension) return fields.wrong_field("space directions");
    for (std::size_t k = 0; k < dimension; ++k) {
      auto& axis = (*axes)[k];
      if (axis && !(*kinds)[k])
        return fields.wrong("its axis " + std::to_string(k) +
                            " has a direction, but is of a kind "
                            "that has none");
      if (axis) axis = to_lps.cwiseProduct(*axis);
    }
    out.axes = std::move(*axes);
  } else {
    out.is_oriented = false;
    std::vector<double> spacings(dimension, kMissing);
    if (fields.get("spacings")) {
      if (const auto ok = fields.numbers("spacings", dimension).into(spacings); !ok)
        return ok.error();
    }
    int next = 0;
    for (std::size_t k = 0; k < dimension; ++k) {
      out.axes.emplace_back();
      if (!(*kinds)[k] || next == 3) continue;
      const double side = std::abs(spacings[k]);
      const bool is_stated = side > 0 && side < 1e7;
      if (!is_stated && !std::isnan(side)) return fields.wrong_field("spacings");
      out.has_size = out.has_size && is_stated;
      out.axes.back() = Eigen::Vector3d::Unit(next++) * (is_stated ? side : 1);
    }
  }
  if (const auto origin = fields.get("space origin")) {
    const auto vectors = vectors_of(*origin);
    if (!vectors || vectors->size() != 1 || !(*vectors)[0])
      return fields.wrong_field("space origin");
    out.origin = to_lps.cwiseProduct(*(*vectors)[0]);
  }
  return out;
}

// Assigns the axes of the file to those of an array of volumes.
Result<void> set_axes(const Fields& fields, const std::vector<std::int64_t>& sizes,
                      const Frame& frame, NiftiHeader& out) {
  int spatial = 0;
  for (std::size_t k = 0; k < sizes.size(); ++k) {
    if (frame.axes[k]) {
      if (spatial == 3) return fields.wrong("more than three of its axes are spatial");
      out.n[static_cast<std::size_t>(spatial)] = sizes[k];
      out.T_lps_voxel.col(spatial++).head<3>() = *frame.axes[k];
    } else if (sizes[k] > 1) {
      if (spatial < 3)
        return fields.wrong("its voxels have " + std::to_string(sizes[k]) + " values each (axis " +
                            std::to_string(k) + " is not spatial); only single values are read");
      out.volumes *= sizes[k];
      if (out.volumes > kMaxVolumes)
        return fields.wrong("more than " + std::to_string(kMaxVolumes) + " volumes");
    }
  }
  if (spatial != 3)
    return fields.wrong("has " + std::to_string(spatial) +
                        " spatial axes; volumes with three are read");
  out.T_lps_voxel.col(3).head<3>() = frame.origin;
  out.has_voxel_size = frame.has_size;
  return {};
}

Result<void> set_values(const Fields& fields, NiftiHeader& out) {
  const auto type = types().find(lower(std::string(fields.get("type").value_or(""))));
  if (type == types().end()) return fields.wrong_field("type");
  out.datatype = type->second.datatype;
  out.bytes_per_voxel = type->second.bytes;
  const std::string endian = lower(std::string(fields.get("endian").value_or("")));
  if (endian != "little" && endian != "big" && (out.bytes_per_voxel > 1 || !endian.empty()))
    return fields.wrong_field("endian");
  out.swapped =
      out.bytes_per_voxel > 1 && (endian == "big") != (std::endian::native == std::endian::big);
  for (const char* const name : {"old min", "old max"})
    if (fields.get(name))
      return fields.wrong("holds quantised values (its field \"" + std::string(name) + "\")");
  return {};
}

// Sets where the data are.
Result<void> set_data(const Fields& fields, NrrdHeader& out) {
  const std::string encoding = lower(std::string(fields.get("encoding").value_or("")));
  out.is_gzip = encoding == "gzip" || encoding == "gz";
  if (!out.is_gzip && encoding != "raw")
    return fields.wrong("encoding " + encoding.substr(0, 60) + " is neither raw nor gzip");
  if (number_of<std::int64_t>(fields.get("line skip").value_or("0")) != 0)
    return fields.wrong_field("line skip");
  const auto skip = number_of<std::int64_t>(fields.get("byte skip").value_or("0"));
  constexpr std::int64_t kMaxSkip = 1'000'000'000'000;
  if (!skip || *skip < -1 || *skip > kMaxSkip || (out.is_gzip && *skip != 0))
    return fields.wrong_field("byte skip");
  out.at_end = *skip == -1;
  out.data_at = std::max<std::int64_t>(*skip, 0);
  const auto file = fields.get("data file");
  if (!file) {
    if (!fields.has_end) return fields.wrong("its header has no end");
    out.data_at += static_cast<std::int64_t>(fields.size);
    return {};
  }
  const auto is_odd = [](char c) {
    return c == '/' || c == '\\' || static_cast<unsigned char>(c) < 0x20;
  };
  if (file->empty() || *file == "." || *file == ".." ||
      std::any_of(file->begin(), file->end(), is_odd))
    return fields.wrong("its data file must be in its own folder: " + std::string(*file));
  if (file->starts_with("LIST")) return fields.wrong("its data are in several files");
  out.data_file = std::string(*file);
  return {};
}

// "Segment0_Name:=L1" and "Segment0_LabelValue:=20".
std::map<int, std::string> names_of_segments(const Fields& fields) {
  constexpr std::string_view kName = "_Name", kSegment = "Segment";
  std::map<int, std::string> out;
  for (const auto& [key, name] : fields.keys) {
    if (!key.starts_with(kSegment) || !key.ends_with(kName)) continue;
    const auto label = fields.keys.find(key.substr(0, key.size() - kName.size()) + "_LabelValue");
    if (label == fields.keys.end()) continue;
    if (const auto value = number_of<int>(label->second); value && *value > 0)
      out.emplace(*value, name);
  }
  return out;
}

// The first MiB of a file, or all if it has less. Errors: kRefused if it cannot be opened.
Result<std::string> nrrd_head(const std::filesystem::path& file) {
  constexpr std::size_t kMaxBytes = 1 << 20;
  const FileDescriptor in(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (in.get() < 0) return refused_by_system(file.string(), errno);
  std::string out(kMaxBytes, '\0');
  out.resize(read_at(in.get(), 0, out));
  return out;
}

// Parses `head`, the result of nrrd_head(). `file` is the file's name in error messages, `volume` the number of the wanted volume.
//
// Three axes must be spatial. A further axis is accepted if it is the slowest one, or if its size
// is 1. Errors: kRefused if the file is not NRRD; if a field that is needed is missing, given twice
// or not valid; if the encoding is neither raw nor gzip, the space neither LPS, RAS nor LAS; if a
// voxel has several values; if the data are in several files or in another folder; kUsage as for
// parse_nifti_header(). Warnings: no_orientation.
Result<NrrdHeader> parse_nrrd_header(std::string_view head, const std::string& file,
                                     std::optional<int> volume, std::vector<Warning>& warnings) {
  const auto fields = Fields::of(head, file);
  if (!fields) return fields.error();
  const auto sizes = sizes_of(*fields);
  if (!sizes) return sizes.error();
  const auto frame = frame_of(*fields, sizes->size());
  if (!frame) return frame.error();
  NrrdHeader out;
  if (auto ok = set_axes(*fields, *sizes, *frame, out.array); !ok) return ok.error();
  if (auto ok = set_values(*fields, out.array); !ok) return ok.error();
  if (auto ok = set_data(*fields, out); !ok) return ok.error();
  if (auto ok = choose_volume(file, volume, out.array); !ok) return ok.error();
  if (!frame->is_oriented)
    warnings.push_back({"no_orientation", file,
                        "the file does not say how its axes lie in the patient; they are taken as "
                        "left, posterior, superior"});
  out.label_names = names_of_segments(*fields);
  return out;
}

// The data's file of an NRRD header, if it has one; std::nullopt if the data follow the header, or
// if `file` is not a NRRD file that can be read.
std::optional<std::filesystem::path> nrrd_data_file(const std::filesystem::path& file) {
  if (!is_nrrd(file)) return {};
  const auto head = nrrd_head(file);
  if (!head) return {};
  const auto fields = Fields::of(*head, file.string());
  NrrdHeader header;
  if (!fields || !set_data(*fields, header) || header.data_file.empty()) return {};
  return file.parent_path() / header.data_file;
}

// As open_nifti(), for a NRRD file with its data, or a header whose data are in another file of
// the same folder. Errors: those of parse_nrrd_header(), VolumeFile::open_part() and open_array().
// Warnings: those of parse_nrrd_header() and open_array().
Result<std::unique_ptr<SliceStack>> open_nrrd(const fs::path& path, const OpenOptions& options,
                                              bool header_only) {
  const std::string file = path.string();
  std::vector<Warning> warnings;
  const auto head = nrrd_head(path);
  if (!head) return head.error();
  const auto header = parse_nrrd_header(*head, file, options.volume, warnings);
  if (!header) return header.error();
  const NiftiHeader& array = header->array;
  const auto open = [&]() -> Result<VolumeFile> {
    const bool is_detached = !header->data_file.empty();
    const fs::path data = is_detached ? path.parent_path() / header->data_file : path;
    std::error_code error;
    const bool is_there = fs::is_regular_file(data, error);
    if (error && is_of_circumstances(error.value()))
      return refused_by_system(data.string(), error.value());
    if (!is_there)
      return refused(file + ": its data file " + header->data_file + " is not in its folder");
    std::int64_t from = header->data_at;
    if (header->at_end) {
      from = static_cast<std::int64_t>(fs::file_size(data, error)) - array.data_end;
      if (error || from < 0)
        return refused(data.string() + ": truncated: its header declares " +
                       std::to_string(array.data_end) + " bytes of voxels");
    }
    return VolumeFile::open_part(data, from, header->is_gzip, array.data_start, array.data_bytes(),
                                 options.unpack_behind, array.data_end);
  };
  auto stack = open_array(file, array, options, std::move(warnings),
                          header_only ? std::function<Result<VolumeFile>()>() : open);
  if (stack) (*stack)->label_names = header->label_names;
  return stack;
}

}  // namespace

Result<std::unique_ptr<SliceStack>> open_volume(const fs::path& file, const OpenOptions& options,
                                                bool header_only) {
  auto stack = is_nrrd(file) ? open_nrrd(file, options, header_only)
                             : open_nifti(file, options, header_only);
  if (stack) (*stack)->files = files_of_volume(file);
  return stack;
}

std::vector<fs::path> files_of_volume(const fs::path& file) {
  std::vector<fs::path> out{file};
  if (auto data = nrrd_data_file(file)) out.push_back(std::move(*data));
  return out;
}

}  // namespace trocar::pipeline
