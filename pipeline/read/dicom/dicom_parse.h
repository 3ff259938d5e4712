// SPDX-License-Identifier: GPL-3.0-or-later
// Parses DICOM files into objects of the library DCMTK, with limits against hostile files.
#pragma once

#include <dcmtk/config/osconfig.h>
#include <dcmtk/dcmdata/dcpxitem.h>
#include <dcmtk/dcmdata/dctk.h>
#include <filesystem>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/dicom/dicom_headers.h"

namespace trocar::pipeline {

/// Registers DCMTK's decoders (RLE, JPEG, JPEG-LS), calls add_known_dicom_elements(), and silences
/// DCMTK's log. Thread-safe; only the first call has an effect. read_dicom_headers() calls it.
void set_up_dcmtk();

/// Loads `file` into `format` up to the element `end`, which is not loaded and may be missing.
/// Without `end`, it loads all elements. Values of more than 4 KiB stay in the file until they are needed,
/// except those of a deflated file. If the result is bad, `format` has what could be read.
///
/// The result is also bad if the file exceeds one of two limits, which DCMTK itself does not have.
/// Nested sequences may need at most 512 KiB of stack, and at most 512 MiB of values may be read
/// into memory. Even a small deflated file can exceed the second limit.
OFCondition load_dicom(const std::filesystem::path& file, DcmFileFormat& format,
                       const DcmTagKey& end = DCM_UndefinedTagKey);

/// The first value of the element `tag` of `item` as text. Empty if `item` is null or has no such
/// element.
std::string dicom_text(DcmItem* item, const DcmTagKey& tag);
/// The text of an element, converted to UTF-8, without spaces around it. If `item` is null, the
/// element belongs to the dataset itself, otherwise to `item`, which is one of the dataset's items.
/// Use the function for texts that may contain letters beyond ASCII.
std::string dicom_utf8(DcmDataset& data, const DcmTagKey& tag, DcmItem* item = nullptr);
/// Reads `count` numbers of an element to `out`. Returns false if `item` is null, or if the element
/// does not have so many finite numbers.
bool dicom_numbers(DcmItem* item, const DcmTagKey& tag, double* out, unsigned count);
/// The value of an unsigned 16-bit element, or `otherwise` if `item` is null or does not have it.
int dicom_integer(DcmItem* item, const DcmTagKey& tag, int otherwise);

/// The pixel data element; null if there is none.
DcmPixelData* dicom_pixel_data(DcmFileFormat& format);

/// Does this transfer syntax store pixels in fragments, as syntaxes for compressed pixels do?
bool dicom_encapsulated(E_TransferSyntax syntax);

/// The fragments of compressed pixels; null if there are none, or if they cannot be read.
DcmPixelSequence* fragments_of(DcmPixelData* pixels, E_TransferSyntax syntax);
/// The fragments after the offset table, in their order.
std::vector<DcmPixelItem*> fragments_in(DcmPixelSequence& sequence);

/// The size in bytes of one frame after decompression, without padding bytes; 0 if the dataset does
/// not state it. `compressed` tells DCMTK whether the file stores the pixels in compressed form.
Uint32 dicom_frame_bytes(const DcmPixelData& pixels, DcmDataset& data, bool compressed);

// Fills the dictionary of DCMTK, the library that parses DICOM files, with the few elements that
// the program needs. DCMTK's own dictionary file is left out. Files in implicit VR do not state the
// type (value representation, VR) of an element, so DCMTK looks it up in the dictionary.

/// Prevents DCMTK from reading its dictionary file, because that takes 13 ms. If the environment
/// variable DCMDICTPATH names a dictionary file, DCMTK still reads it. Call this function first in
/// main(), and only in a program that needs no elements other than those of
/// add_known_dicom_elements().
void leave_out_dicom_dictionary();

/// Adds the elements that trocar-mesh uses to DCMTK's dictionary, unless they are there already.
/// set_up_dcmtk() calls this function.
void add_known_dicom_elements();

// Reads which images a DICOMDIR names.

/// The paths of the images that a DICOMDIR names, relative to its folder. Empty if it cannot be
/// read.
std::vector<std::filesystem::path> images_of_dicomdir(const std::filesystem::path& dicomdir);

// A cache of parsed multi-frame DICOM files, so that a file is not parsed again for each frame.

/// Keeps the parsed multi-frame files that no thread is using. A thread calls take() to get the
/// file of a frame, reads the frame, and calls give_back(). Before take() parses a file, it drops
/// an unused one, so there are never more parsed files than threads. Thread-safe. Errors of take():
/// kRefused if the file cannot be parsed.
class ParsedFiles {
 public:
  Result<std::unique_ptr<DcmFileFormat>> take(const DicomFrame& h) {
    {
      const std::lock_guard lock(mutex_);
      for (auto it = idle_.begin(); it != idle_.end(); ++it) {
        if (it->first != h.file) continue;
        auto out = std::move(it->second);
        idle_.erase(it);
        return out;
      }
      if (!idle_.empty()) idle_.erase(idle_.begin());
    }
    auto format = std::make_unique<DcmFileFormat>();
    if (load_dicom(h.file, *format).bad()) return refused(h.name() + ": cannot be read");
    return format;
  }
  void give_back(const DicomFrame& h, std::unique_ptr<DcmFileFormat> format) {
    if (h.frames == 1) return;
    const std::lock_guard lock(mutex_);
    idle_.emplace_back(h.file, std::move(format));
  }

 private:
  std::mutex mutex_;
  std::vector<std::pair<std::filesystem::path, std::unique_ptr<DcmFileFormat>>> idle_;
};

}  // namespace trocar::pipeline
