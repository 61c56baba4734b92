// SPDX-License-Identifier: BSD-3-Clause
#include "python/options.h"

#include <algorithm>
#include <stdexcept>

namespace dsorb::python {
namespace {

namespace nb = nanobind;

constexpr const char* kOrigin = "option";

/// What a configuration file would say: true, not True.
std::string textOf(nb::handle value) {
  std::string text = nb::str(value).c_str();
  if (text == "True") return "true";
  if (text == "False") return "false";
  return text;
}

void flatten(const std::string& key, nb::handle value, std::vector<ConfigAssignment>& list) {
  constexpr int kDeepest = 8;  // no key is; a dictionary may hold itself
  if (std::count(key.begin(), key.end(), '.') > kDeepest) {
    throw std::invalid_argument("options: '" + key + "' is nested deeper than any option");
  }
  if (!nb::isinstance<nb::dict>(value)) {
    list.push_back({key == "initializer" ? "initializer.kind" : key, textOf(value), kOrigin});
    return;
  }
  for (const auto& [name, entry] : nb::cast<nb::dict>(value)) {
    std::string path = key;
    if (!path.empty()) path += ".";
    flatten(path += textOf(name), entry, list);
  }
}

}  // namespace

Config configOf(nb::handle initializer,
                const std::string& preset,
                nb::handle options,
                const nb::kwargs& words) {
  ConfigSources sources;
  sources.preset = preset;
  sources.program_defaults = {{"num_threads", "0", kOrigin}};
  if (!options.is_none()) {
    if (!nb::isinstance<nb::dict>(options)) {
      throw std::invalid_argument("options: expected a dictionary");
    }
    flatten("", options, sources.assignments);
  }
  flatten("", words, sources.assignments);
  if (!initializer.is_none()) flatten("initializer", initializer, sources.assignments);
  return loadConfig(sources);
}

}  // namespace dsorb::python
