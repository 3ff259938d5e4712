// SPDX-License-Identifier: GPL-3.0-or-later
// Parses DICOM files into objects of the library DCMTK, with limits against hostile files.
#pragma once

#include <dcmtk/config/osconfig.h>
#include <dcmtk/dcmdata/dctk.h>

#include <array>
#include <filesystem>
#include <string>

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

/// The size in bytes of one frame after decompression, without padding bytes; 0 if the dataset does
/// not state it. `compressed` tells DCMTK whether the file stores the pixels in compressed form.
Uint32 dicom_frame_bytes(const DcmPixelData& pixels, DcmDataset& data, bool compressed);

}  // namespace trocar::pipeline
