// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/dicom/dicom_pixels.h"

#include <dcmtk/dcmdata/dccodec.h>
#include <dcmtk/dcmdata/dcfcache.h>
#include <dcmtk/dcmdata/dcrledec.h>
#include <algorithm>

#include "pipeline/read/image_file.h"

namespace trocar::pipeline {
namespace {

// DCMTK keeps the fragments that it has read in memory; this releases them.
void release_fragments(DcmPixelSequence& sequence) {
  DcmObject* item = nullptr;
  while ((item = sequence.nextInContainer(item)) != nullptr) {
    if (auto* element = dynamic_cast<DcmElement*>(item)) element->compact();
  }
}

// The bytes of a fragment; their data() is null if it cannot be read.
std::span<const std::uint8_t> fragment_of(DcmPixelSequence& sequence, Uint32 index) {
  DcmPixelItem* item = nullptr;
  Uint8* bytes = nullptr;
  if (sequence.getItem(item, index).bad() || item == nullptr || item->getUint8Array(bytes).bad() ||
      bytes == nullptr)
    return {};
  return {bytes, item->getLength()};
}

// The indices at which the frames begin according to the offset table; empty if it does not fit the
// fragments.
std::vector<std::uint32_t> starts_by_table(DcmPixelSequence& sequence,
                                           const std::vector<DcmPixelItem*>& fragments,
                                           std::size_t frames) {
  constexpr std::uint32_t kItemHeader = 8;
  const auto table = fragment_of(sequence, 0);
  if (table.size() != frames * 4) return {};
  std::vector<std::uint32_t> out;
  std::uint64_t position = 0;
  for (std::size_t i = 0; i < fragments.size() && out.size() < frames; ++i) {
    if (fragments[i] == nullptr) return {};
    const auto* offset = table.data() + 4 * out.size();
    if (position == (offset[0] | offset[1] << 8 | offset[2] << 16 | std::uint32_t{offset[3]} << 24))
      out.push_back(static_cast<std::uint32_t>(i) + 1);
    position += kItemHeader + fragments[i]->getLength();
  }
  return out.size() == frames ? out : std::vector<std::uint32_t>();
}

// The indices at which the frames begin, where a fragment begins a JPEG, JPEG-LS or JPEG 2000 image
// (SOI, or SOC and SIZ) and the fragment before it ends one (EOI or EOC, and padding). None of these
// markers can be in compressed data at the end of a fragment.
std::vector<std::uint32_t> starts_by_markers(const std::vector<DcmPixelItem*>& fragments) {
  std::vector<std::uint32_t> out;
  DcmFileCache cache;
  bool is_over = true;  // the image before this fragment
  for (std::size_t i = 0; i < fragments.size(); ++i) {
    const Uint32 size = fragments[i] == nullptr ? 0 : fragments[i]->getLength();
    std::array<std::uint8_t, 4> head{};
    std::array<std::uint8_t, 16> tail{};
    const auto tail_size = static_cast<Uint32>(std::min<std::size_t>(size, tail.size()));
    if (size == 0) continue;
    if (size < head.size() || fragments[i]->getPartialValue(head.data(), 0, 4, &cache).bad() ||
        fragments[i]->getPartialValue(tail.data(), size - tail_size, tail_size, &cache).bad())
      return {};
    const bool begins =
        head[0] == 0xff &&
        (head[1] == 0xd8 || (head[1] == 0x4f && head[2] == 0xff && head[3] == 0x51));
    if (is_over != begins) return {};
    if (begins) out.push_back(static_cast<std::uint32_t>(i) + 1);
    std::size_t end = tail_size;
    while (end > 2 && tail[end - 1] == 0)
      --end;
    is_over = end >= 2 && tail[end - 2] == 0xff && tail[end - 1] == 0xd9;
  }
  return out;
}

// The encapsulated bytes of one frame, made by joining its fragments.
Result<std::vector<std::uint8_t>> join_fragments(const DicomFrame& h, DcmFileFormat& format,
                                                 DcmPixelSequence& sequence) {
  std::optional<FragmentRange> range = h.fragments;
  if (!range) {
    const auto all = frame_fragments(format, h.frames);
    if (!all) return refused(h.file.string() + ": " + all.error().message);
    range = (*all)[static_cast<std::size_t>(h.frame)];
  }
  std::vector<std::uint8_t> out;
  for (std::uint32_t i = range->first; i < range->second; ++i) {
    const auto bytes = fragment_of(sequence, i);
    if (bytes.data() == nullptr)
      return refused(h.name() + ": a fragment of its pixels cannot be read");
    out.insert(out.end(), bytes.begin(), bytes.end());
  }
  return out;
}

// The contents of a JPEG's frame header.
struct JpegFrame {
  int precision = 0, rows = 0, columns = 0;
};

// All members are 0 if the header is not at the position where it must be. (ISO 10918-1, B.1: all
// segments before it state their length.)
JpegFrame jpeg_frame(std::span<const std::uint8_t> jpeg) {
  if (jpeg.size() < 4 || jpeg[0] != 0xff || jpeg[1] != 0xd8) return {};
  for (std::size_t at = 2; at + 5 < jpeg.size();) {
    const int marker = jpeg[at + 1];
    if (jpeg[at] != 0xff) return {};
    const bool tables = marker == 0xc4 || marker == 0xcc || marker == 0xdb || marker == 0xdd;
    if (marker >= 0xc0 && marker <= 0xcf && !tables && marker != 0xc8) {
      if (at + 8 >= jpeg.size()) return {};
      return {jpeg[at + 4], jpeg[at + 5] << 8 | jpeg[at + 6], jpeg[at + 7] << 8 | jpeg[at + 8]};
    }
    if (!tables && marker != 0xfe && (marker < 0xe0 || marker > 0xef)) return {};
    at += 2 + static_cast<std::size_t>(jpeg[at + 2] << 8 | jpeg[at + 3]);
  }
  return {};
}

// DCMTK's decoder does not terminate if a frame has no frame header. It does not compare the JPEG's
// size with that of the header either: rows of another length would be sheared.
Result<void> check_jpeg(const DicomFrame& h, std::span<const std::uint8_t> jpeg) {
  const JpegFrame frame = jpeg_frame(jpeg);
  const int precision = frame.precision;
  if (precision < 2 || precision > 16) return refused(h.name() + ": its JPEG pixels are damaged");
  if ((precision <= 8) != (h.bits_allocated == 8)) {
    return refused(h.name() + ": its JPEG has " + std::to_string(precision) +
                   " bits a sample, its header allocates " + std::to_string(h.bits_allocated));
  }
  if (frame.columns != h.columns || frame.rows != h.rows) {
    return refused(h.name() + ": its JPEG has " + std::to_string(frame.columns) + " x " +
                   std::to_string(frame.rows) + " pixels, its header " + std::to_string(h.columns) +
                   " x " + std::to_string(h.rows));
  }
  return {};
}

// The samples as stored words. With lossy coding, values may exceed the range of the stored bits.
// They are clamped, since masking them would turn white into black.
Result<std::vector<std::uint16_t>> decode_jpeg2000_words(
    const DicomFrame& h, const std::vector<std::uint8_t>& codestream) {
  const auto decoded = decode_jpeg2000(codestream, h.columns, h.rows, h.name());
  if (!decoded) return decoded.error();
  const bool shifted = h.high_bit != h.bits_stored - 1;
  const int low = h.is_signed ? -(1 << (h.bits_stored - 1)) : 0,
            high = low + (1 << h.bits_stored) - 1;
  std::vector<std::uint16_t> words;
  words.reserve(decoded->samples.size());
  for (int value : decoded->samples) {
    if (!shifted && decoded->is_signed == h.is_signed) value = std::clamp(value, low, high);
    words.push_back(static_cast<std::uint16_t>(value));
  }
  return words;
}

// There is one segment for each byte of a word, the high byte first (DICOM PS3.5, annex G). DCMTK's
// own codec silently fills in the missing part of a damaged segment. Here it is an error.
Result<std::vector<std::uint16_t>> decode_rle(const DicomFrame& h,
                                              const std::vector<std::uint8_t>& bytes) {
  const std::size_t count = static_cast<std::size_t>(h.columns) * h.rows;
  const std::size_t segments = h.bits_allocated / 8;
  const auto u32 = [&bytes](std::size_t at) {
    return static_cast<std::size_t>(bytes[at] | bytes[at + 1] << 8 | bytes[at + 2] << 16) |
           static_cast<std::size_t>(bytes[at + 3]) << 24;
  };
  const auto damaged = [&h] {
    return refused(h.name() + ": its RLE pixels are damaged or truncated");
  };
  if (bytes.size() < 64 || u32(0) != segments) return damaged();
  std::vector<std::uint16_t> words(count);
  for (std::size_t s = 0; s < segments; ++s) {
    const std::size_t from = u32(4 + 4 * s), to = s + 1 < segments ? u32(8 + 4 * s) : bytes.size();
    if (from < 64 || from >= to || to > bytes.size()) return damaged();
    DcmRLEDecoder decoder(count);
    // A padding byte may follow, so a surplus alone is not an error.
    decoder.decompress(const_cast<std::uint8_t*>(bytes.data() + from), to - from);  // only read
    if (decoder.size() != count) return damaged();
    const auto* plane = static_cast<const std::uint8_t*>(decoder.getOutputBuffer());
    for (std::size_t i = 0; i < count; ++i)
      words[i] = static_cast<std::uint16_t>(words[i] << 8 | plane[i]);
  }
  return words;
}

// Decodes the frame `index` of `pixels`, an element of `data`.
Result<std::vector<std::uint16_t>> decode_by_dcmtk(const DicomFrame& h, DcmDataset& data,
                                                   DcmPixelData& pixels, int index,
                                                   E_TransferSyntax syntax) {
  const bool compressed = dicom_encapsulated(syntax);
  const std::size_t count = static_cast<std::size_t>(h.columns) * h.rows;
  std::vector<std::uint16_t> words(count);
  const std::size_t bytes = count * (h.bits_allocated / 8);
  Uint32 fragment = 0;
  OFString colour_model;
  const Uint32 frame_size = dicom_frame_bytes(pixels, data, compressed);
  if (frame_size != bytes && frame_size != bytes + 1)
    return refused(h.name() + ": its frames are not of " + std::to_string(bytes) + " bytes");
  words.resize(std::max(count, (static_cast<std::size_t>(frame_size) + 1) / 2));
  // DCMTK needs a buffer of even size, even for a frame with an odd number of bytes.
  const auto buffer_size = static_cast<Uint32>(words.size() * sizeof(std::uint16_t));
  const OFCondition done = pixels.getUncompressedFrame(&data, static_cast<Uint32>(index), fragment,
                                                       words.data(), buffer_size, colour_model);
  if (done.bad()) {
    const bool known =
        DcmCodecList::canChangeCoding(syntax, EXS_LittleEndianExplicit) || !compressed;
    return refused(h.name() +
                   (known ? ": its pixels are damaged or truncated ("
                          : ": no decoder for its transfer syntax (") +
                   DcmXfer(syntax).getXferName() + ": " + done.text() + ")");
  }
  if (h.bits_allocated == 8) {  // bytes to words in place, from the last one down
    const auto* packed = reinterpret_cast<const std::uint8_t*>(words.data());
    for (std::size_t i = count; i-- > 0;)
      words[i] = packed[i];
  }
  words.resize(count);
  return words;
}

// Decodes a JPEG or JPEG-LS. It becomes a dataset of one frame in one fragment, because DCMTK finds
// the fragments of a frame by the offset table alone.
Result<std::vector<std::uint16_t>> decode_jpeg(const DicomFrame& h, DcmDataset& data,
                                               E_TransferSyntax syntax,
                                               std::vector<std::uint8_t>& jpeg) {
  if (jpeg.size() % 2 != 0) jpeg.push_back(0);
  DcmDataset one;
  for (const DcmTagKey& tag : {DCM_SamplesPerPixel, DCM_PhotometricInterpretation, DCM_Rows,
                               DCM_Columns, DCM_BitsAllocated, DCM_BitsStored, DCM_HighBit,
                               DCM_PixelRepresentation, DCM_PlanarConfiguration}) {
    if (DcmElement* element = nullptr; data.findAndGetElement(tag, element).good())
      one.insert(dynamic_cast<DcmElement*>(element->clone()));
  }
  auto sequence = std::make_unique<DcmPixelSequence>(DcmTag(DCM_PixelData, EVR_OB));
  const DcmTag item_tag(0xfffe, 0xe000, EVR_OB);
  sequence->insert(new DcmPixelItem(item_tag));  // an empty offset table
  auto item = std::make_unique<DcmPixelItem>(item_tag);
  if (item->putUint8Array(jpeg.data(), static_cast<unsigned long>(jpeg.size())).bad())
    return refused(h.name() + ": its compressed pixels cannot be read");
  sequence->insert(item.release());
  auto pixels = std::make_unique<DcmPixelData>(DCM_PixelData);
  pixels->putOriginalRepresentation(syntax, nullptr, sequence.release());
  DcmPixelData& element = *pixels;
  one.insert(pixels.release());
  return decode_by_dcmtk(h, one, element, 0, syntax);
}

// `pixels` is the pixel data element, or null; `sequence` is the result of fragments_of().
Result<std::vector<std::uint16_t>> decode_words(const DicomFrame& h, DcmFileFormat& format,
                                                DcmPixelData* pixels, DcmPixelSequence* sequence) {
  if (pixels == nullptr) return refused(h.name() + ": its PixelData element is of another kind");
  DcmDataset& data = *format.getDataset();
  const E_TransferSyntax syntax = data.getOriginalXfer();
  if (!dicom_encapsulated(syntax)) return decode_by_dcmtk(h, data, *pixels, h.frame, syntax);
  if (sequence == nullptr) return refused(h.name() + ": its compressed pixels cannot be read");
  auto joined = join_fragments(h, format, *sequence);
  if (!joined) return joined.error();
  if (syntax == EXS_RLELossless) return decode_rle(h, *joined);
  if (syntax == EXS_JPEG2000LosslessOnly || syntax == EXS_JPEG2000)
    return decode_jpeg2000_words(h, *joined);
  const bool is_jpeg_ls = syntax == EXS_JPEGLSLossless || syntax == EXS_JPEGLSLossy;
  if (!is_jpeg_ls && DcmCodecList::canChangeCoding(syntax, EXS_LittleEndianExplicit)) {
    if (auto ok = check_jpeg(h, *joined); !ok) return ok.error();
  }
  return decode_jpeg(h, data, syntax, *joined);
}

}  // namespace

Result<std::vector<FragmentRange>> frame_fragments(DcmFileFormat& format, int frames) {
  DcmPixelSequence* const sequence =
      fragments_of(dicom_pixel_data(format), format.getDataset()->getOriginalXfer());
  if (sequence == nullptr) return std::vector<FragmentRange>();
  const auto fragments = fragments_in(*sequence);
  const auto count = static_cast<std::size_t>(frames);
  const auto end = static_cast<std::uint32_t>(fragments.size()) + 1;
  std::vector<std::uint32_t> starts;
  if (frames == 1) {
    starts = {1};
  } else if (fragments.size() == count) {
    for (std::uint32_t i = 1; i < end; ++i)
      starts.push_back(i);
  } else {
    starts = starts_by_table(*sequence, fragments, count);
    if (starts.empty()) starts = starts_by_markers(fragments);
  }
  if (starts.size() != count || fragments.empty()) {
    return refused("the " + std::to_string(fragments.size()) +
                   " fragments of its pixels cannot be assigned to " + std::to_string(frames) +
                   (frames == 1 ? " frame" : " frames") +
                   ", neither by its offset table nor by markers in them");
  }
  std::vector<FragmentRange> out;
  for (std::size_t i = 0; i < count; ++i)
    out.emplace_back(starts[i], i + 1 < count ? starts[i + 1] : end);
  return out;
}

Result<Image> read_dicom_frame(const DicomFrame& h, DcmFileFormat& format) {
  DcmDataset& data = *format.getDataset();
  DcmPixelData* const pixels = dicom_pixel_data(format);
  DcmPixelSequence* const sequence = fragments_of(pixels, data.getOriginalXfer());
  const auto words = decode_words(h, format, pixels, sequence);
  if (sequence != nullptr) release_fragments(*sequence);
  if (!words) return words.error();
  Image out{h.columns, h.rows, {}};
  // No branch depends on a sample, so that a compiler can convert several samples at once.
  const int shift = h.high_bit - (h.bits_stored - 1), mask = (1 << h.bits_stored) - 1,
            sign = h.is_signed ? 1 << (h.bits_stored - 1) : 0;
  const auto stored = [=](std::uint16_t word) { return (((word >> shift) & mask) ^ sign) - sign; };
  out.values.resize(words->size());
  for (std::size_t i = 0; i < words->size(); ++i)
    out.values[i] = static_cast<float>(stored((*words)[i]) * h.slope + h.intercept);
  if (h.has_dense_padding()) {
    const auto [low, high] = *h.padding;
    for (std::size_t i = 0; i < words->size(); ++i)
      if (const int value = stored((*words)[i]); value >= low && value <= high)
        out.values[i] = kNoData_HU;
  }
  return out;
}

}  // namespace trocar::pipeline
