// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/error.h"
#include "dsorb/options/field.h"

#include <cstddef>
#include <functional>
#include <initializer_list>
#include <optional>
#include <sstream>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

namespace dsorb {

/// An enumeration behind its names.
struct Choice {
  std::vector<std::string> names;
  std::function<std::optional<std::size_t>()> get;  ///< index into names; empty: not a named value
  std::function<void(std::size_t)> set;
};

/// One member of an option struct, by its dotted path. Points into the struct it was listed from,
/// which must outlive it.
struct OptionField {
  std::string key;   ///< for example "initializer.orb.min_frames"
  std::string unit;  ///< for people; empty when there is none
  Range range{0, 0};
  std::variant<bool*, int*, float*, double*, Choice> value;
};

/// The visitor that turns the field lists of nested option structs into one flat list; everything
/// else (reading, writing, overriding, validating, comparing) is plain code over that list.
class FieldLister {
 public:
  template <typename Number>
  void field(const char* name, Number& member, Range range, const char* unit) {
    fields_.push_back({prefix_ + name, unit, range, &member});
  }
  void field(const char* name, bool& member) {
    fields_.push_back({prefix_ + name, "", {0, 1}, &member});
  }
  template <typename Enum>
  void choice(const char* name, Enum& member, std::initializer_list<NamedValue<Enum>> names) {
    Choice choice;
    std::vector<Enum> values;
    for (const NamedValue<Enum>& entry : names) {
      choice.names.emplace_back(entry.name);
      values.push_back(entry.value);
    }
    choice.get = [values, &member]() -> std::optional<std::size_t> {
      for (std::size_t i = 0; i < values.size(); ++i) {
        if (values[i] == member) return i;
      }
      return std::nullopt;
    };
    choice.set = [values, &member](std::size_t index) { member = values.at(index); };
    fields_.push_back({prefix_ + name, "", {0, 0}, std::move(choice)});
  }
  template <typename Nested>
  void group(const char* name, Nested& options) {
    const std::size_t length = prefix_.size();
    prefix_ += std::string(name) + ".";
    describe(*this, options);
    prefix_.resize(length);
  }

  [[nodiscard]] std::vector<OptionField> take() { return std::move(fields_); }

 private:
  std::string prefix_;
  std::vector<OptionField> fields_;
};

/// Every member of an option struct, nested ones included, in the order of the struct.
template <typename Options>
[[nodiscard]] std::vector<OptionField> listFields(Options& options) {
  FieldLister lister;
  describe(lister, options);
  return lister.take();
}

/// What a field accepts, for messages: "a number in [0.1, 255] grey levels".
[[nodiscard]] inline std::string expectation(const OptionField& field) {
  std::ostringstream text;
  if (const auto* choice = std::get_if<Choice>(&field.value)) {
    text << "one of";
    for (std::size_t i = 0; i < choice->names.size(); ++i) {
      text << (i == 0 ? " " : ", ") << choice->names[i];
    }
  } else if (std::holds_alternative<bool*>(field.value)) {
    text << "true or false";
  } else {
    text.precision(15);
    text << (std::holds_alternative<int*>(field.value) ? "a whole number" : "a number") << " in ["
         << field.range.low << ", " << field.range.high << "]";
    if (!field.unit.empty()) text << " " << field.unit;
  }
  return text.str();
}

/// Whether the field's present value is one that it accepts.
[[nodiscard]] inline bool isValid(const OptionField& field) {
  const auto inside = [&field](double value) {  // false for nan
    return value >= field.range.low && value <= field.range.high;
  };
  if (const auto* choice = std::get_if<Choice>(&field.value)) return choice->get().has_value();
  if (const auto* number = std::get_if<int*>(&field.value)) return inside(**number);
  if (const auto* number = std::get_if<float*>(&field.value)) return inside(**number);
  if (const auto* number = std::get_if<double*>(&field.value)) return inside(**number);
  return true;
}

/// Checks every member against its range.
/// @throws ConfigError naming the key, its value's range and unit
template <typename Options>
void validateOptions(const Options& options) {
  Options copy = options;
  for (const OptionField& field : listFields(copy)) {
    if (!isValid(field)) {
      throw ConfigError("option " + field.key + " must be " + expectation(field));
    }
  }
}

/// Keys whose values differ between two structs of one type.
template <typename Options>
[[nodiscard]] std::vector<std::string> differingKeys(const Options& left, const Options& right) {
  Options left_copy = left;
  Options right_copy = right;
  const std::vector<OptionField> left_fields = listFields(left_copy);
  const std::vector<OptionField> right_fields = listFields(right_copy);
  std::vector<std::string> keys;
  for (std::size_t i = 0; i < left_fields.size(); ++i) {
    const bool same = std::visit(
        [&other = right_fields[i].value](const auto& value) {
          using Value = std::decay_t<decltype(value)>;
          const auto& other_value = std::get<Value>(other);
          if constexpr (std::is_same_v<Value, Choice>) {
            return value.get() == other_value.get();
          } else {
            return *value == *other_value;
          }
        },
        left_fields[i].value);
    if (!same) keys.push_back(left_fields[i].key);
  }
  return keys;
}

}  // namespace dsorb
