// SPDX-License-Identifier: GPL-3.0-or-later
// Encryption (TLS) of DICOM connections (associations). Without encryption, scans must not leave
// this computer, unless the user gives --insecure.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "formats/base/result.h"

class DcmTransportLayer;

namespace trocar::archive {

/// PEM files. Either all three are given, or none.
struct TlsFiles {
  std::filesystem::path key;   ///< private key of this side
  std::filesystem::path cert;  ///< certificate of this side
  std::filesystem::path ca;    ///< authorities; one must have signed the other side's certificate

  bool is_given() const { return !key.empty() || !cert.empty() || !ca.empty(); }
};

/// Checks that the three files are given together or not at all. If none is given, `host` must be
/// this computer, because otherwise scans would cross the network unencrypted. `insecure` = true
/// permits other hosts too (option --insecure). Errors: kUsage if a check fails (the message names
/// the options); kRefused if `host` cannot be resolved.
Result<void> check_transport(const TlsFiles& files, const std::string& host, bool insecure);

enum class TlsRole { kServer, kClient };

/// Makes DCMTK's transport layer with TLS 1.2 or later and the ciphers of BCP 195 (the internet's
/// recommendations for TLS). The layer requires and verifies the certificate of the other side.
/// Returns null if no files are given. Errors: kRefused if a file cannot be used (the message names
/// it), or if OpenSSL has none of the ciphers.
Result<std::shared_ptr<DcmTransportLayer>> make_transport(const TlsFiles& files, TlsRole role);

}  // namespace trocar::archive
