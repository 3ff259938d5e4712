// SPDX-License-Identifier: GPL-3.0-or-later
// The pixels of one DICOM frame, in HU.
// Tests: tests/pipeline/read/dicom/dicom_variants_test.py
#pragma once

#include "formats/base/result.h"
#include "pipeline/read/dicom/dicom_headers.h"
#include "pipeline/read/dicom/dicom_parse.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// Decodes the pixels of a frame. `format` is the loaded file that `h` describes. Supported are
/// uncompressed pixels in either byte order, deflated files, RLE, JPEG baseline, extended and
/// lossless, JPEG-LS (DCMTK) and JPEG 2000 (OpenJPEG). Of an uncompressed or encapsulated file only
/// this frame is read, and `format` does not keep its pixels. Dense padding
/// (DicomFrame::has_dense_padding()) becomes kNoData_HU. Errors: kRefused if the pixels are damaged
/// or truncated, or have another transfer syntax.
Result<Image> read_dicom_frame(const DicomFrame& h, DcmFileFormat& format);

}  // namespace trocar::pipeline
