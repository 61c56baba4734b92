// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/io/config.h"

#include "dsorb/error.h"

#include "base/describe.h"
#include "io/calibration/keyed_values.h"
#include "io/presets.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <map>
#include <numeric>

namespace dsorb {
namespace {

constexpr const char* kVariantKey = "initializer.kind";
constexpr std::size_t kMaxCompared = 64;  // characters of a wrong name, which a file may make long

/// The key that is closest as a whole, or by an ending, which is accepted too.
std::string closestKey(const std::string& word, const std::vector<OptionField>& fields) {
  std::map<std::string, std::string> keys;  // by all their endings
  std::vector<std::string> endings;
  for (const OptionField& field : fields) {
    for (std::string ending = field.key;; ending.erase(0, ending.find('.') + 1)) {
      if (keys.emplace(ending, field.key).second) endings.push_back(ending);
      if (ending.find('.') == std::string::npos) break;
    }
  }
  return keys.at(closestName(word, endings));
}

/// Whether `key` ends with `end` at a dot: "b.c" is an end of "a.b.c".
bool isEndOfKey(const std::string& end, const std::string& key) {
  return key.size() > end.size() && key[key.size() - end.size() - 1] == '.' &&
         key.compare(key.size() - end.size(), end.size(), end) == 0;
}

/// The field with this key; else the only one whose key ends with it at a dot, unless it names a
/// group.
OptionField& findField(std::vector<OptionField>& fields, const ConfigAssignment& assignment) {
  std::vector<OptionField*> ending;
  for (OptionField& field : fields) {
    if (field.key == assignment.key) return field;
    if (field.key.compare(0, assignment.key.size() + 1, assignment.key + ".") == 0) {
      throw ConfigError(
          fmt::format("{}: '{}' is a group of keys, not an option; one of its keys is '{}'",
                      assignment.origin,
                      assignment.key,
                      field.key));
    }
    if (isEndOfKey(assignment.key, field.key)) ending.push_back(&field);
  }
  if (ending.size() == 1) return *ending.front();
  if (ending.size() > 1) {
    throw ConfigError(fmt::format("{}: key '{}' could be {} or {}",
                                  assignment.origin,
                                  assignment.key,
                                  ending[0]->key,
                                  ending[1]->key));
  }
  throw ConfigError(fmt::format("{}: unknown key '{}'; the closest valid key is '{}'",
                                assignment.origin,
                                assignment.key,
                                closestKey(assignment.key, fields)));
}

bool parseValue(const std::string& text, bool* value) {
  if (text != "true" && text != "false") return false;
  *value = text == "true";
  return true;
}
template <typename Number>
bool parseValue(const std::string& text, Number* value) {
  const char* const begin = text.data() + (!text.empty() && text.front() == '+' ? 1 : 0);
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(begin, end, *value);
  return error == std::errc() && stop == end;
}
bool parseValue(const std::string& text, Choice& choice) {
  const auto found = std::find(choice.names.begin(), choice.names.end(), text);
  if (found == choice.names.end()) return false;
  choice.set(static_cast<std::size_t>(found - choice.names.begin()));
  return true;
}

void assign(std::vector<OptionField>& fields, const ConfigAssignment& assignment) {
  OptionField& field = findField(fields, assignment);
  const bool parsed = std::visit(
      [&assignment](auto& value) { return parseValue(assignment.value, value); }, field.value);
  if (!parsed || !isValid(field)) {
    throw ConfigError(fmt::format("{}: {} = '{}': must be {}",
                                  assignment.origin,
                                  field.key,
                                  assignment.value,
                                  expectation(field)));
  }
}

std::string valueText(const OptionField& field) {
  if (const auto* choice = std::get_if<Choice>(&field.value)) {
    const auto index = choice->get();
    if (!index) throw ConfigError("option " + field.key + " must be " + expectation(field));
    return choice->names[*index];
  }
  if (const auto* flag = std::get_if<bool*>(&field.value)) return **flag ? "true" : "false";
  if (const auto* number = std::get_if<int*>(&field.value)) return fmt::format("{}", **number);
  if (const auto* number = std::get_if<float*>(&field.value)) return fmt::format("{}", **number);
  return fmt::format("{}", *std::get<double*>(field.value));
}

/// @throws ConfigError also where the file cannot be read
std::vector<ConfigAssignment> assignmentsIn(const std::string& file) {
  try {
    return io::readYamlAssignments(readText(file, kMaxYamlBytes), file);
  } catch (const IoError& error) {
    throw ConfigError(error.what());
  }
}

const io::Preset& findPreset(const std::string& name) {
  for (const io::Preset& preset : io::presets()) {
    if (name == preset.name) return preset;
  }
  throw ConfigError(fmt::format(
      "--preset {}: this version lacks it; it has {}", name, fmt::join(presetNames(), ", ")));
}

bool namesVariant(const ConfigAssignment& assignment) {
  return assignment.key == kVariantKey || assignment.key == "kind";
}

/// @throws ConfigError with the place where the name was written
InitializerOptions namedVariant(const ConfigAssignment& choice) {
  try {
    return initializerVariant(choice.value);
  } catch (const ConfigError& error) {
    throw ConfigError(fmt::format("{}: {}", choice.origin, error.what()));
  }
}

/// Sets what distinguishes the variant from the defaults, and nothing else, so that a preset keeps
/// its say about the rest.
void applyVariant(const ConfigAssignment& choice, Config& config) {
  InitializerOptions variant = namedVariant(choice);
  config.initializer = choice.value;
  const std::vector<std::string> keys = differingKeys(InitializerOptions{}, variant);
  std::vector<OptionField> target = listFields(config.options.initializer);
  for (const OptionField& field : listFields(variant)) {
    if (std::find(keys.begin(), keys.end(), field.key) != keys.end()) {
      assign(target, {field.key, valueText(field), "initializer " + choice.value});
    }
  }
  config.options.initializer.kind = variant.kind;
  config.options.initializer.registered = variant.registered;
}

}  // namespace

Config loadConfig(const ConfigSources& sources) {
  const io::Preset& preset = findPreset(sources.preset);
  std::vector<ConfigAssignment> before =
      io::readYamlAssignments(preset.yaml, fmt::format("preset {}", sources.preset));
  before.insert(before.end(), sources.program_defaults.begin(), sources.program_defaults.end());
  std::vector<ConfigAssignment> after;
  for (const std::string& file : sources.files) {
    const auto assignments = assignmentsIn(file);
    after.insert(after.end(), assignments.begin(), assignments.end());
  }
  after.insert(after.end(), sources.assignments.begin(), sources.assignments.end());
  after.insert(after.end(), sources.flags.begin(), sources.flags.end());

  Config config;
  ConfigAssignment variant{kVariantKey, config.initializer, "default"};
  for (const auto* list : {&before, &after}) {
    for (const ConfigAssignment& assignment : *list) {
      if (namesVariant(assignment)) variant = assignment;
    }
  }
  std::vector<OptionField> fields = listFields(config.options);
  const auto assign_all = [&fields](const std::vector<ConfigAssignment>& list) {
    for (const ConfigAssignment& assignment : list) {
      if (!namesVariant(assignment)) assign(fields, assignment);
    }
  };
  assign_all(before);
  applyVariant(variant, config);
  assign_all(after);
  return config;
}

std::string toYaml(const Config& config) {
  OdometryOptions options = config.options;
  std::string text;
  std::vector<std::string> open;  // groups the last line stands in
  for (const OptionField& field : listFields(options)) {
    std::string words = field.key;
    std::replace(words.begin(), words.end(), '.', ' ');
    const std::vector<std::string> path = splitWords(words);
    const std::size_t depth = path.size() - 1;
    std::size_t common = 0;
    while (common < std::min(open.size(), depth) && open[common] == path[common]) ++common;
    for (std::size_t level = common; level < depth; ++level) {
      text += fmt::format("{:{}}{}:\n", "", 2 * level, path[level]);
    }
    open.assign(path.begin(), path.end() - 1);
    const bool variant = field.key == kVariantKey;
    text += fmt::format("{:{}}{}: {}  # {}\n",
                        "",
                        2 * depth,
                        path.back(),
                        variant ? config.initializer : valueText(field),
                        variant ? fmt::format("one of {}", fmt::join(initializerVariants(), ", "))
                                : expectation(field));
  }
  return text;
}

std::vector<std::string> presetNames() {
  std::vector<std::string> names;
  for (const io::Preset& preset : io::presets()) names.emplace_back(preset.name);
  return names;
}

ConfigAssignment parseAssignment(const std::string& text, const std::string& origin) {
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos || equals == 0) {
    throw ConfigError(fmt::format("{} {}: expected key=value", origin, text));
  }
  return {text.substr(0, equals), text.substr(equals + 1), origin};
}

std::string closestName(const std::string& word, const std::vector<std::string>& candidates) {
  const std::size_t length = std::min(word.size(), kMaxCompared);
  std::string best;
  std::size_t best_distance = 0;
  for (const std::string& candidate : candidates) {
    const auto [shorter, longer] = std::minmax({length, candidate.size()});
    if (!best.empty() && longer - shorter >= best_distance) continue;
    // Levenshtein distance, one row of the table at a time.
    std::vector<std::size_t> row(candidate.size() + 1);
    std::iota(row.begin(), row.end(), std::size_t{0});
    for (std::size_t i = 0; i < length; ++i) {
      std::size_t diagonal = row[0]++;
      for (std::size_t j = 0; j < candidate.size(); ++j) {
        const std::size_t replaced = diagonal + (word[i] == candidate[j] ? 0 : 1);
        diagonal = row[j + 1];
        row[j + 1] = std::min({replaced, row[j] + 1, row[j + 1] + 1});
      }
    }
    if (best.empty() || row.back() < best_distance) {
      best = candidate;
      best_distance = row.back();
    }
  }
  return best;
}

}  // namespace dsorb
