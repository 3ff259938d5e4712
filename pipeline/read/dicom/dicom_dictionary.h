// SPDX-License-Identifier: GPL-3.0-or-later
// The dictionary of DCMTK, the library that parses DICOM files. Files in implicit VR do not state
// the type (value representation, VR) of an element, so DCMTK looks it up in the dictionary. The
// program needs few elements, so it adds them itself and leaves DCMTK's dictionary file out.
// Tests: tests/pipeline/read/dicom/dicom_dictionary_test.cpp
#pragma once

namespace trocar::pipeline {

/// Prevents DCMTK from reading its dictionary file, because that takes 13 ms. If the environment
/// variable DCMDICTPATH names a dictionary file, DCMTK still reads it. Call this function first in
/// main(), and only in a program that needs no elements other than those of
/// add_known_dicom_elements().
void leave_out_dicom_dictionary();

/// Adds the elements that trocar-mesh uses to DCMTK's dictionary, unless they are there already.
/// set_up_dcmtk() calls this function.
void add_known_dicom_elements();

}  // namespace trocar::pipeline
