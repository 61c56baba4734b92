// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/cxx17.h"

#include <type_traits>

namespace dsorb {

/// Closed range of values an option may take.
struct Range {
  double low;   ///< included
  double high;  ///< included
};

/// One value of an enumeration and its name in configuration files.
template <typename Enum>
struct NamedValue {
  const char* name;  ///< in configuration files
  Enum value;        ///< that it stands for
};

/// Return type of `describe(visitor, options)` for the option struct `Struct`, const or not. A
/// visitor has
///   field(name, member, Range, unit)     numbers: int, float or double
///   field(name, member)                  bool
///   choice(name, member, {{"orb", InitializerKind::kOrb}, ...})   enumerations, as NamedValue
///   group(name, nested_options)          nested structs
/// in the order of the struct; reading, writing, overriding and validating all walk this one list
/// (base/describe.h). An owner of options checks them with validateOptions(options).
template <typename Options, typename Struct>
using DescribeFor = std::enable_if_t<std::is_same_v<std::remove_const_t<Options>, Struct>>;

}  // namespace dsorb
