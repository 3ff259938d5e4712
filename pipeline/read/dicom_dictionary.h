// SPDX-License-Identifier: GPL-3.0-or-later
// DCMTK's dictionary says of each element how its value is represented, which files in implicit VR
// do not.
#pragma once

namespace trocar::pipeline {

/// Has DCMTK not read its dictionary's file, 5,000 lines of text that take 13 ms, unless the
/// environment names one (DCMDICTPATH). For a program that only reads, and only by dicom_parse.h;
/// to be called first in main().
void leave_out_dicom_dictionary();

/// Adds every element that is read here where the dictionary lacks it. Others are then read as of
/// unknown representation.
void add_known_dicom_elements();

}  // namespace trocar::pipeline
