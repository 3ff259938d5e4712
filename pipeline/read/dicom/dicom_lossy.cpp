// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/dicom/dicom_lossy.h"

#include <algorithm>
#include <cstdlib>
#include <sstream>
#include <string_view>

#include "pipeline/read/number_ranges.h"

namespace trocar::pipeline {
namespace {

// The defined terms of LossyImageCompressionMethod.
constexpr auto kMethods = std::to_array<std::pair<std::string_view, std::string_view>>(
    {{"ISO_10918_1", "JPEG"},
     {"ISO_14495_1", "JPEG-LS"},
     {"ISO_15444_1", "JPEG 2000"},
     {"ISO_15444_15", "High-Throughput JPEG 2000"},
     {"ISO_18181_1", "JPEG XL"},
     {"ISO_13818_2", "MPEG-2"},
     {"ISO_14496_10", "MPEG-4"},
     {"ISO_23008_2", "HEVC"}});

std::string method_text(const std::string& value) {
  const std::string term = value.substr(0, value.find_last_not_of(' ') + 1);
  const auto* const found = std::find_if(kMethods.begin(), kMethods.end(),
                                         [&](const auto& m) { return m.first == term; });
  if (found != kMethods.end()) return std::string(found->second);
  return term.empty() ? "" : "a method that DICOM does not define";
}

// Several compressions have a value each.
std::string methods_text(const std::string& values) {
  std::string out, value;
  for (std::istringstream in(values); std::getline(in, value, '\\');) {
    const std::string one = method_text(value);
    if (!one.empty()) out += (out.empty() ? "" : ", then ") + one;
  }
  return out;
}

double largest_ratio(const std::string& values) {
  double out = 0;
  std::string value;
  for (std::istringstream in(values); std::getline(in, value, '\\');) {
    const double ratio = std::strtod(value.c_str(), nullptr);
    if (ratio > out && ratio < 1e6) out = ratio;
  }
  return out;
}

// What an item of the dataset says about lossy compression.
struct Statement {
  std::string is_lossy;  // "01", "00", or empty if it says nothing
  LossyCompression compression;
};

Statement statement_in(DcmItem& item, bool into_sequences) {
  const OFBool deep = into_sequences ? OFTrue : OFFalse;
  OFString stated, method, ratio;
  item.findAndGetOFString(DCM_LossyImageCompression, stated, 0, deep);
  item.findAndGetOFStringArray(DCM_LossyImageCompressionMethod, method, deep);
  item.findAndGetOFStringArray(DCM_LossyImageCompressionRatio, ratio, deep);
  Statement out{stated.c_str(), {methods_text(method.c_str()), largest_ratio(ratio.c_str())}};
  const bool has_more = !out.compression.method.empty() || out.compression.ratio > 0;
  if (out.is_lossy == "1" || (out.is_lossy.empty() && has_more)) out.is_lossy = "01";
  return out;
}

// The first statement that there was lossy compression, or else the dataset's own.
Statement statement_of(DcmDataset& data) {
  Statement own = statement_in(data, false);
  if (own.is_lossy == "01") return own;
  for (const DcmTagKey& tag :
       {DCM_SharedFunctionalGroupsSequence, DCM_PerFrameFunctionalGroupsSequence}) {
    DcmSequenceOfItems* groups = nullptr;
    data.findAndGetSequence(tag, groups);
    for (DcmObject* at = nullptr;
         groups != nullptr && (at = groups->nextInContainer(at)) != nullptr;) {
      auto* const item = dynamic_cast<DcmItem*>(at);
      if (item == nullptr) continue;
      Statement found = statement_in(*item, true);
      if (found.is_lossy == "01") return found;
    }
  }
  return own;
}

// The method of transfer syntaxes that may be lossy; empty for others.
std::string_view method_of(E_TransferSyntax syntax) {
  switch (syntax) {
    case EXS_JPEGProcess1:
    case EXS_JPEGProcess2_4:
    case EXS_JPEGProcess3_5:
    case EXS_JPEGProcess6_8:
    case EXS_JPEGProcess7_9:
    case EXS_JPEGProcess10_12:
    case EXS_JPEGProcess11_13:
    case EXS_JPEGProcess16_18:
    case EXS_JPEGProcess17_19:
    case EXS_JPEGProcess20_22:
    case EXS_JPEGProcess21_23:
    case EXS_JPEGProcess24_26:
    case EXS_JPEGProcess25_27:
      return "JPEG";
    case EXS_JPEGLSLossy:
      return "JPEG-LS";
    case EXS_JPEG2000:
    case EXS_JPEG2000Multicomponent:
      return "JPEG 2000";
    default:
      return {};
  }
}

// The first bytes of the first fragment, and the number of bytes in all fragments.
struct Fragments {
  std::vector<std::uint8_t> head;
  double bytes = 0;
};

Fragments look_at_fragments(DcmFileFormat& format) {
  constexpr Uint32 kHead = 4096;
  Fragments out;
  DcmPixelSequence* const sequence =
      fragments_of(dicom_pixel_data(format), format.getDataset()->getOriginalXfer());
  if (sequence == nullptr) return out;
  for (DcmPixelItem* const item : fragments_in(*sequence)) {
    if (item == nullptr) continue;
    const Uint32 size = item->getLength();
    if (out.bytes == 0 && size > 0) {
      out.head.resize(std::min(size, kHead));
      if (item->getPartialValue(out.head.data(), 0, static_cast<Uint32>(out.head.size())).bad())
        out.head.clear();
    }
    out.bytes += size;
  }
  return out;
}

// The payload of the first segment with this marker in a header of segments that state their
// length; empty if there is none. `head` begins with a marker without a length.
std::vector<std::uint8_t> segment(const std::vector<std::uint8_t>& head, int marker) {
  for (std::size_t at = 2; at + 4 <= head.size() && head[at] == 0xff;) {
    const std::size_t size = static_cast<std::size_t>(head[at + 2] << 8 | head[at + 3]);
    if (size < 2 || at + 2 + size > head.size()) return {};
    const auto begin = head.begin() + static_cast<std::ptrdiff_t>(at + 4);
    if (head[at + 1] == marker) return {begin, begin + static_cast<std::ptrdiff_t>(size - 2)};
    at += 2 + size;
  }
  return {};
}

// JPEG-LS: NEAR is the largest error of a sample (ISO 14495-1, C.2.3). 0 is lossless.
bool is_exact_jpeg_ls(const std::vector<std::uint8_t>& head) {
  const auto scan = segment(head, 0xda);
  const std::size_t near = scan.empty() ? 0 : 1 + 2 * std::size_t{scan[0]};
  return near != 0 && near < scan.size() && scan[near] == 0;
}

// JPEG 2000: a reversible transformation (ISO 15444-1, A.6.1) can be lossless, the other cannot.
bool is_reversible_jpeg2000(const std::vector<std::uint8_t>& head) {
  constexpr std::size_t kTransformation = 9;
  const auto coding = segment(head, 0x52);
  return coding.size() > kTransformation && coding[kTransformation] == 1;
}

}  // namespace

std::optional<LossyCompression> lossy_compression(DcmFileFormat& format, int frames) {
  DcmDataset& data = *format.getDataset();
  Statement stated = statement_of(data);
  const E_TransferSyntax syntax = data.getOriginalXfer();
  const std::string method(method_of(syntax));
  bool is_lossy = stated.is_lossy == "01";
  if (!is_lossy && method.empty()) return {};
  if (method.empty()) return std::move(stated.compression);
  const Fragments fragments = look_at_fragments(format);
  if (syntax == EXS_JPEGLSLossy)
    is_lossy = is_lossy || !is_exact_jpeg_ls(fragments.head);
  else if (method == "JPEG 2000")
    is_lossy = is_lossy || stated.is_lossy != "00" || !is_reversible_jpeg2000(fragments.head);
  else
    is_lossy = true;
  if (!is_lossy) return {};
  LossyCompression& out = stated.compression;
  if (out.method.empty()) out.method = method;
  const double bytes = static_cast<double>(dicom_integer(&data, DCM_Rows, 0)) *
                       dicom_integer(&data, DCM_Columns, 0) * frames *
                       dicom_integer(&data, DCM_BitsAllocated, 0) / 8;
  if (out.ratio == 0 && fragments.bytes > 0) out.ratio = bytes / fragments.bytes;
  return std::move(out);
}

void warn_of_lossy(const std::vector<DicomFile>& files, const std::set<std::filesystem::path>& used,
                   std::vector<Warning>& warnings) {
  const DicomFile* first = nullptr;
  std::map<std::string, std::pair<double, double>> ratios;  // of each method: lowest and highest
  std::size_t count = 0;
  for (const DicomFile& file : files) {
    if (!file.lossy || !used.contains(file.file)) continue;
    if (count++ == 0) first = &file;
    const auto& [method, ratio] = *file.lossy;
    auto& [low, high] = ratios.try_emplace(method, ratio, ratio).first->second;
    low = std::min(low, ratio);
    high = std::max(high, ratio);
  }
  if (first == nullptr) return;
  std::string text;
  for (const auto& [method, range] : ratios) {
    const std::string low = text_of(range.first, 3), high = text_of(range.second, 3);
    text += (text.empty() ? "" : "; ") + (method.empty() ? "method not stated" : method) +
            (range.second == 0 ? ", ratio not stated" : ", ratio " + high) +
            (range.second == 0 || low == high ? "" : " at most");
  }
  warnings.push_back({"lossy_compression", first->file.string(),
                      "the pixels of " + std::to_string(count) + " of " +
                          std::to_string(used.size()) + (used.size() == 1 ? " file" : " files") +
                          " have been compressed with loss (this is the first): " + text +
                          "; outlines and HU can differ from those of the scanner"});
}

}  // namespace trocar::pipeline
