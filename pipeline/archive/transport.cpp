// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/archive/transport.h"

#include <dcmtk/config/osconfig.h>
#include <dcmtk/dcmtls/tlslayer.h>
#include <netdb.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <array>
#include <system_error>

#include "pipeline/read/dicom/dicom_parse.h"

namespace trocar::archive {
namespace {

bool is_loopback(const sockaddr& address) {
  if (address.sa_family == AF_INET)
    return ntohl(reinterpret_cast<const sockaddr_in&>(address).sin_addr.s_addr) >> 24 == 127;
  return address.sa_family == AF_INET6 &&
         IN6_IS_ADDR_LOOPBACK(&reinterpret_cast<const sockaddr_in6&>(address).sin6_addr);
}

// Does every address of the host belong to this computer alone?
Result<bool> is_this_computer(const std::string& host) {
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  if (const int error = ::getaddrinfo(host.c_str(), nullptr, &hints, &found); error != 0) {
    if (host == "localhost") return true;  // RFC 6761; some containers have no /etc/hosts
    return refused(host + ": " + ::gai_strerror(error));
  }
  bool out = true;
  for (const addrinfo* at = found; at != nullptr; at = at->ai_next)
    out = out && is_loopback(*at->ai_addr);
  ::freeaddrinfo(found);
  return out;
}

}  // namespace

Result<void> check_transport(const TlsFiles& files, const std::string& host, bool insecure) {
  if (files.is_given()) {
    if (files.key.empty() || files.cert.empty() || files.ca.empty())
      return usage("--tls-key, --tls-cert and --tls-ca must be given together");
    return {};
  }
  if (insecure) return {};
  const auto is_local = is_this_computer(host);
  if (!is_local) return is_local.error();
  if (!*is_local)
    return usage(host +
                 " is reached over the network; give --tls-key, --tls-cert and --tls-ca, or "
                 "--insecure to send scans unencrypted");
  return {};
}

Result<std::shared_ptr<DcmTransportLayer>> make_transport(const TlsFiles& files, TlsRole role) {
  if (!files.is_given()) return std::shared_ptr<DcmTransportLayer>();
  pipeline::set_up_dcmtk();  // silences its log
  auto out = std::make_shared<DcmTLSTransportLayer>(
      role == TlsRole::kServer ? NET_ACCEPTOR : NET_REQUESTOR, nullptr, OFTrue);
  const auto wrong = [](const std::filesystem::path& file, const char* what) {
    std::error_code error;
    return refused(file.string() + (std::filesystem::exists(file, error)
                                        ? std::string(": is no ") + what + " in PEM format"
                                        : std::string(": no such file")));
  };
  if (out->setPrivateKeyFile(files.key.c_str(), DCF_Filetype_PEM).bad())
    return wrong(files.key, "private key");
#if PACKAGE_VERSION_NUMBER >= 368
  const OFCondition has_certificate =
      out->setCertificateFile(files.cert.c_str(), DCF_Filetype_PEM, TSP_Profile_BCP195_ND);
#else
  const OFCondition has_certificate = out->setCertificateFile(files.cert.c_str(), DCF_Filetype_PEM);
#endif
  if (has_certificate.bad()) return wrong(files.cert, "certificate of at least 2048 bits");
  if (!out->checkPrivateKeyMatchesCertificate())
    return refused(files.key.string() + ": is not the private key of " + files.cert.string());
  if (out->addTrustedCertificateFile(files.ca.c_str(), DCF_Filetype_PEM).bad())
    return wrong(files.ca, "certificate");
  if (out->setTLSProfile(TSP_Profile_BCP195_ND).bad() || out->activateCipherSuites().bad())
    return refused("OpenSSL has none of the ciphers of BCP 195");
  out->setCertificateVerification(DCV_requireCertificate);
  return std::shared_ptr<DcmTransportLayer>(std::move(out));
}

}  // namespace trocar::archive
