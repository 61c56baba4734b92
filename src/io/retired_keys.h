// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

namespace dsorb::io {

/// A key that configuration files of earlier versions may have. CHANGELOG.md lists the same keys.
struct RetiredKey {
  const char* key;
  const char*
      fate;  ///< end of a sentence that begins with the key: "is now the option 'brightness'"
};

[[nodiscard]] const std::vector<RetiredKey>& retiredKeys();

/// The retired key that a user may have meant: this one, or else the first that ends with it at a
/// dot; null when there is none.
[[nodiscard]] const RetiredKey* findRetiredKey(const std::string& key);

}  // namespace dsorb::io
