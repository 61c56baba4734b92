// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <type_traits>

namespace dsorb {

/// Closed range of values an option may take.
struct Range {
  double low;
  double high;
};

/// Return type of `describe(visitor, options)` for the option struct `Struct`, const or not. A
/// visitor has
///   field(name, member, Range, unit)     numbers; bool members come without range and unit
///   choice(name, member, names...)       enumerations
///   group(name, nested_options)          nested structs
/// in the order of the struct; reading, writing, overriding and validating all walk this one list.
template <typename Options, typename Struct>
using DescribeFor = std::enable_if_t<std::is_same_v<std::remove_const_t<Options>, Struct>>;

}  // namespace dsorb
