// SPDX-License-Identifier: BSD-3-Clause
#include "base/describe.h"

#include <gmock/gmock.h>

#include <limits>

namespace dsorb {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

enum class Colour { kRed, kBlue, kUnnamed };

struct Inner {
  double weight = 0.5;
  bool active = true;
};

template <typename Visitor, typename Options>
DescribeFor<Options, Inner> describe(Visitor& visit, Options& o) {
  visit.field("weight", o.weight, Range{0, 1}, "");
  visit.field("active", o.active);
}

struct Outer {
  int count = 3;
  float length = 2;
  Colour colour = Colour::kRed;
  Inner inner;
};

template <typename Visitor, typename Options>
DescribeFor<Options, Outer> describe(Visitor& visit, Options& o) {
  visit.field("count", o.count, Range{1, 10}, "frames");
  visit.field("length", o.length, Range{0, 5}, "px");
  visit.choice("colour", o.colour, {{"red", Colour::kRed}, {"blue", Colour::kBlue}});
  visit.group("inner", o.inner);
}

TEST(Describe, ListsNestedMembersByTheirDottedPathInOrder) {
  Outer options;
  std::vector<std::string> keys;
  for (const OptionField& field : listFields(options)) keys.push_back(field.key);
  EXPECT_THAT(keys, ElementsAre("count", "length", "colour", "inner.weight", "inner.active"));
}

TEST(Describe, FieldsPointIntoTheStruct) {
  Outer options;
  const auto fields = listFields(options);
  *std::get<int*>(fields[0].value) = 7;
  std::get<Choice>(fields[2].value).set(1);
  EXPECT_EQ(options.count, 7);
  EXPECT_EQ(options.colour, Colour::kBlue);
}

TEST(Describe, DefaultsAreValid) {
  EXPECT_NO_THROW(validateOptions(Outer{}));
}

TEST(Describe, ValidationNamesKeyRangeAndUnit) {
  Outer options;
  options.count = 11;
  try {
    validateOptions(options);
    FAIL() << "11 was accepted";
  } catch (const ConfigError& error) {
    EXPECT_THAT(error.what(), HasSubstr("count must be a whole number in [1, 10] frames"));
  }
}

TEST(Describe, ValidationRefusesNanAndUnnamedChoices) {
  Outer not_a_number;
  not_a_number.inner.weight = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(validateOptions(not_a_number), ConfigError);
  Outer unnamed;
  unnamed.colour = Colour::kUnnamed;
  EXPECT_THROW(validateOptions(unnamed), ConfigError);
}

TEST(Describe, NamesEveryDifference) {
  Outer other;
  EXPECT_THAT(differingKeys(Outer{}, other), IsEmpty());
  other.length = 2.5F;
  other.colour = Colour::kBlue;
  other.inner.active = false;
  EXPECT_THAT(differingKeys(Outer{}, other), ElementsAre("length", "colour", "inner.active"));
}

}  // namespace
}  // namespace dsorb
