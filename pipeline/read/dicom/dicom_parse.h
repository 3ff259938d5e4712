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

/// Loads `file`; values longer than some kilobytes stay in the file until they are needed (except
/// in a deflated file). What could be read is in `format` even if the result is bad. Also bad:
/// nested sequences that need more than 512 KiB of stack, and more than 512 MiB of values (as a
/// small deflated file may have). DCMTK itself has no such limits.
OFCondition load_dicom(const std::filesystem::path& file, DcmFileFormat& format);

/// The same up to the pixel data, which is not read and may be missing.
OFCondition load_dicom_header(const std::filesystem::path& file, DcmFileFormat& format);

/// The element's text, empty if there is none. `item` may be null in all that take one.
std::string dicom_text(DcmItem* item, const DcmTagKey& tag);
/// The text of an element of the dataset, or of one of its items, as UTF-8 without spaces around
/// it. It may have letters beyond ASCII.
std::string dicom_utf8(DcmDataset& data, const DcmTagKey& tag, DcmItem* item = nullptr);
/// Reads `count` finite numbers; false if the element does not have them.
bool dicom_numbers(DcmItem* item, const DcmTagKey& tag, double* out, unsigned count);
int dicom_integer(DcmItem* item, const DcmTagKey& tag, int otherwise);

/// The pixel data element, null if there is none.
DcmPixelData* dicom_pixel_data(DcmFileFormat& format);

/// True if pixels of this transfer syntax stand in fragments, as compressed ones do.
bool dicom_encapsulated(E_TransferSyntax syntax);

/// The size in bytes of one frame of uncompressed pixels, without padding; 0 if the dataset does not say it.
/// `compressed` tells how the pixels stand in the file.
Uint32 dicom_frame_bytes(const DcmPixelData& pixels, DcmDataset& data, bool compressed);

}  // namespace trocar::pipeline
