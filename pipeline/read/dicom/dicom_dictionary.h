// SPDX-License-Identifier: GPL-3.0-or-later
// DCMTK's dictionary gives the value representation of each element, which files
// in implicit VR leave out.
// Tests: tests/pipeline/read/dicom/dicom_dictionary_test.cpp
#pragma once

namespace trocar::pipeline {

/// Keeps DCMTK from reading its dictionary file, 5,000 lines of text that take 13 ms, unless the
/// environment names one (DCMDICTPATH). Call it first in main(), in a program that only reads, and
/// only by dicom_parse.h.
void leave_out_dicom_dictionary();

/// Adds the elements that these readers use to the dictionary if it lacks them. Other elements are
/// then read with unknown representation.
void add_known_dicom_elements();

}  // namespace trocar::pipeline
