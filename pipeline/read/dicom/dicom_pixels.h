// SPDX-License-Identifier: GPL-3.0-or-later
// Decodes the pixels of one DICOM frame.
#pragma once

#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/dicom/dicom_headers.h"
#include "pipeline/read/dicom/dicom_parse.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// Decodes the pixels of the frame `h` and applies the rescale, which gives HU for a CT. `format`
/// is the loaded file of the frame. Only the pixels of this frame are read, and `format` does not
/// keep them. (A deflated file is an exception: `format` holds all of its pixels already.) If
/// stored values that mark padding would be taken for tissue (DicomFrame::has_dense_padding()),
/// pixels with padding become kNoData_HU.
///
/// The fragments of a frame of compressed pixels come from the offset table or, if it is empty, from
/// their number or the markers at which a JPEG begins and ends.
///
/// Supported transfer syntaxes: uncompressed pixels in either byte order, deflated files, RLE, JPEG
/// baseline, extended and lossless, JPEG-LS, and JPEG 2000. Errors: kRefused if the pixels are
/// damaged or truncated, or have another transfer syntax.
Result<Image> read_dicom_frame(const DicomFrame& h, DcmFileFormat& format);

/// The fragments of each frame of compressed pixels: the first one, and the one after the last.
/// Empty if the pixels are not compressed. Errors: kRefused if the fragments cannot be assigned to
/// frames; the message does not name the file.
Result<std::vector<FragmentRange>> frame_fragments(DcmFileFormat& format, int frames);

}  // namespace trocar::pipeline
