// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nlohmann/json.hpp>

#include <string>

namespace dsorb::io {

using Json = nlohmann::ordered_json;

/// Text of a JSON value, indented; arrays of plain values stay on one line. Numbers are the
/// shortest that read back the same, but a `timestamp` has nine decimals as in every file; nan and
/// infinity become null.
[[nodiscard]] std::string jsonText(const Json& value);

/// The same for a value inside of another, without a line break at the end.
/// @param depth number of objects and arrays around it
[[nodiscard]] std::string jsonText(const Json& value, int depth);

/// The double whose shortest text is that of the float: 0.1f gives 0.1.
[[nodiscard]] double shortest(float value);

}  // namespace dsorb::io
