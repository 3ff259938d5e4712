// SPDX-License-Identifier: Apache-2.0
// Positions in the patient's frame (DICOM's LPS, mm) and in {B} (m).

/// `rows`: 3 rows of 4 numbers, from {B} to the patient (`lps_mm_of_device` of /api/bone).
export const to_patient = (rows, at_m) => rows.map((row) => row[0] * at_m[0] + row[1] * at_m[1] + row[2] * at_m[2] + row[3]);

/// The inverse of to_patient(). The rows are a rotation times a scale, so the transposed matrix over the square of the scale inverts them.
export function to_device(rows, at_mm) {
  const square = rows[0][0] ** 2 + rows[1][0] ** 2 + rows[2][0] ** 2;
  return [0, 1, 2].map((k) => rows.reduce((sum, row, i) => sum + row[k] * (at_mm[i] - row[3]), 0) / square);
}

export const point_text = (at_mm) => at_mm.map((x) => x.toFixed(1)).join(", ");
