// SPDX-License-Identifier: BSD-3-Clause
#include "io/retired_keys.h"

#include "io/yaml_assignments.h"

#include <algorithm>

namespace dsorb::io {

const std::vector<RetiredKey>& retiredKeys() {
  static const std::vector<RetiredKey> keys = {
      {"initializer.orb.semi_dense.patch", "is gone: the patch is always the 8-pixel pattern"},
      {"initializer.orb.semi_dense.brightness",
       "is gone: patches are always compared by the affine brightness of their frames"},
      {"initializer.orb.semi_dense.line_error",
       "is gone: it is always the pose covariance across the epipolar line"},
  };
  return keys;
}

const RetiredKey* findRetiredKey(const std::string& key) {
  const std::vector<RetiredKey>& keys = retiredKeys();
  auto found =
      std::find_if(keys.begin(), keys.end(), [&key](const auto& old) { return old.key == key; });
  if (found == keys.end()) {
    found = std::find_if(
        keys.begin(), keys.end(), [&key](const auto& old) { return isEndOfKey(key, old.key); });
  }
  return found == keys.end() ? nullptr : &*found;
}

}  // namespace dsorb::io
