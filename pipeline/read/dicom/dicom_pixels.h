// SPDX-License-Identifier: GPL-3.0-or-later
// The pixels of one DICOM frame, in HU.
// Tests: tests/pipeline/read/dicom/dicom_variants_test.py
#pragma once

#include "formats/base/result.h"
#include "pipeline/read/dicom/dicom_headers.h"
#include "pipeline/read/dicom/dicom_parse.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// Decodes the frame `h` of its loaded file. Supported are uncompressed pixels in either byte
/// order, deflated files, RLE, JPEG baseline, extended and lossless, JPEG-LS (DCMTK) and JPEG 2000
/// (OpenJPEG). From an uncompressed or encapsulated file only this frame is read, and `format`
/// keeps nothing of it. Dense padding (DicomFrame::has_dense_padding()) becomes kNoData_HU. Errors
/// (refused): the pixels are damaged or truncated, or have another transfer syntax.
Result<Image> read_dicom_frame(const DicomFrame& h, DcmFileFormat& format);

}  // namespace trocar::pipeline
