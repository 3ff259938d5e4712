// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/dicom_pixels.h"

#include <dcmtk/dcmdata/dccodec.h>
#include <dcmtk/dcmdata/dcpixseq.h>
#include <dcmtk/dcmdata/dcpxitem.h>

#include <algorithm>

#include "pipeline/jpeg2000.h"

namespace trocar::pipeline {
namespace {

// Fragments that were read stay in DCMTK's memory; forget them.
void forget_fragments(DcmPixelSequence& sequence) {
  DcmObject* item = nullptr;
  while ((item = sequence.nextInContainer(item)) != nullptr) {
    if (auto* element = dynamic_cast<DcmElement*>(item)) element->compact();
  }
}

// The encapsulated bytes of one frame, its fragments joined.
Result<std::vector<std::uint8_t>> join_fragments(const DicomFrame& h, DcmPixelSequence& sequence) {
  Uint32 first = 0, end = static_cast<Uint32>(sequence.card());
  const Uint32 frame = static_cast<Uint32>(h.frame);
  if (DcmCodec::determineStartFragment(frame, h.frames, &sequence, first).bad() ||
      (h.frame + 1 < h.frames &&
       DcmCodec::determineStartFragment(frame + 1, h.frames, &sequence, end).bad()) ||
      end <= first) {
    return refused(h.name() + ": its fragments cannot be told apart");
  }
  std::vector<std::uint8_t> out;
  for (Uint32 i = first; i < end; ++i) {
    DcmPixelItem* item = nullptr;
    Uint8* bytes = nullptr;
    if (sequence.getItem(item, i).bad() || item == nullptr || item->getUint8Array(bytes).bad() ||
        bytes == nullptr) {
      return refused(h.name() + ": a fragment of its pixels cannot be read");
    }
    out.insert(out.end(), bytes, bytes + item->getLength());
  }
  return out;
}

Result<std::vector<std::uint16_t>> decode_words(const DicomFrame& h, DcmFileFormat& format) {
  DcmDataset& data = *format.getDataset();
  DcmPixelData* pixels = dicom_pixel_data(format);
  if (pixels == nullptr) return refused(h.name() + ": its pixel data is not pixel data");
  const E_TransferSyntax syntax = data.getOriginalXfer();
  DcmPixelSequence* sequence = nullptr;
  if (DcmXfer(syntax).isEncapsulated() &&
      (pixels->getEncapsulatedRepresentation(syntax, nullptr, sequence).bad() ||
       sequence == nullptr)) {
    return refused(h.name() + ": its compressed pixels cannot be read");
  }
  const std::size_t count = static_cast<std::size_t>(h.columns) * h.rows;
  if (syntax == EXS_JPEG2000LosslessOnly || syntax == EXS_JPEG2000) {
    const auto codestream = join_fragments(h, *sequence);
    if (!codestream) return codestream.error();
    return decode_jpeg2000(*codestream, h.columns, h.rows, h.name());
  }

  std::vector<std::uint16_t> words(count);
  const std::size_t bytes = count * (h.bits_allocated / 8);
  Uint32 frame_size = 0, fragment = 0;
  OFString colour_model;
  if (pixels->getUncompressedFrameSize(&data, frame_size).bad() ||
      (frame_size != bytes && frame_size != bytes + 1)) {
    return refused(h.name() + ": its frames are not of " + std::to_string(bytes) + " bytes");
  }
  words.resize(std::max(count, (static_cast<std::size_t>(frame_size) + 1) / 2));
  const OFCondition done = pixels->getUncompressedFrame(
      &data, static_cast<Uint32>(h.frame), fragment, words.data(), frame_size, colour_model);
  if (done.bad()) {
    const bool known =
        DcmCodecList::canChangeCoding(syntax, EXS_LittleEndianExplicit) || sequence == nullptr;
    return refused(h.name() +
                   (known ? ": its pixels are damaged or truncated ("
                          : ": no decoder for its transfer syntax (") +
                   DcmXfer(syntax).getXferName() + ": " + done.text() + ")");
  }
  if (h.bits_allocated == 8) {  // spread the bytes, from the last one down
    const auto* packed = reinterpret_cast<const std::uint8_t*>(words.data());
    for (std::size_t i = count; i-- > 0;)
      words[i] = packed[i];
  }
  words.resize(count);
  return words;
}

}  // namespace

Result<Image> read_dicom_frame(const DicomFrame& h, DcmFileFormat& format) {
  const auto words = decode_words(h, format);
  DcmPixelSequence* sequence = nullptr;
  if (DcmPixelData* pixels = dicom_pixel_data(format)) {
    const E_TransferSyntax syntax = format.getDataset()->getOriginalXfer();
    if (DcmXfer(syntax).isEncapsulated() &&
        pixels->getEncapsulatedRepresentation(syntax, nullptr, sequence).good() &&
        sequence != nullptr) {
      forget_fragments(*sequence);
    }
  }
  if (!words) return words.error();
  Image out{h.columns, h.rows, {}};
  out.values.resize(words->size());
  const int shift = h.high_bit - (h.bits_stored - 1);
  const int mask = (1 << h.bits_stored) - 1, sign = 1 << (h.bits_stored - 1);
  for (std::size_t i = 0; i < words->size(); ++i) {
    int value = ((*words)[i] >> shift) & mask;
    if (h.is_signed && (value & sign) != 0) value -= mask + 1;
    out.values[i] = static_cast<float>(value * h.slope + h.intercept);
  }
  return out;
}

}  // namespace trocar::pipeline
