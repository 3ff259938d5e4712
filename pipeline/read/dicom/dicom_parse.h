// SPDX-License-Identifier: GPL-3.0-or-later
// Parses DICOM files into DCMTK's objects, with limits against hostile files.
// Tests: tests/pipeline/read/dicom/dicom_variants_test.py
#pragma once

#include <dcmtk/config/osconfig.h>
#include <dcmtk/dcmdata/dctk.h>

#include <array>
#include <filesystem>
#include <string>

namespace trocar::pipeline {

/// Registers DCMTK's codecs (RLE, JPEG, JPEG-LS) and the elements read here, and silences its log.
/// Thread-safe; only the first call has an effect.
void set_up_dcmtk();

/// Loads `file`. Values longer than some kilobytes stay in the file until they are needed, except
/// in a deflated file. Even if the result is bad, `format` has what could be read. The result is
/// also bad if nested sequences need more than 512 KiB of stack, or if there are more than 512 MiB
/// of values (which even a small deflated file may have). DCMTK itself has no such limits.
OFCondition load_dicom(const std::filesystem::path& file, DcmFileFormat& format);

/// The same as load_dicom() up to the pixel data, which are not read and may be missing.
OFCondition load_dicom_header(const std::filesystem::path& file, DcmFileFormat& format);

/// The element's text; empty if there is none. `item` may be null here and in the functions below.
std::string dicom_text(DcmItem* item, const DcmTagKey& tag);
/// The text of an element, converted to UTF-8, without spaces around it. The element belongs to
/// `item`, one of the dataset's items, or to the dataset itself if `item` is null. Use the function
/// for texts that may contain letters beyond ASCII.
std::string dicom_utf8(DcmDataset& data, const DcmTagKey& tag, DcmItem* item = nullptr);
/// Reads `count` finite numbers; false if the element does not have them.
bool dicom_numbers(DcmItem* item, const DcmTagKey& tag, double* out, unsigned count);
/// The element's value, or `otherwise` if the element is missing.
int dicom_integer(DcmItem* item, const DcmTagKey& tag, int otherwise);

/// The pixel data element; null if there is none.
DcmPixelData* dicom_pixel_data(DcmFileFormat& format);

/// Does this transfer syntax store pixels in fragments, as syntaxes for compressed pixels do?
bool dicom_encapsulated(E_TransferSyntax syntax);

/// The size in bytes of one frame of uncompressed pixels, without padding; 0 if the dataset does
/// not state it. `compressed` is true if the file stores the pixels in compressed form.
Uint32 dicom_frame_bytes(const DcmPixelData& pixels, DcmDataset& data, bool compressed);

}  // namespace trocar::pipeline
