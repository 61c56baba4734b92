// SPDX-License-Identifier: BSD-3-Clause
// What is no image of the sequence, cannot be read, is too large, or is a mosaic.
#include "dsorb/io/sequence_reader.h"

#include "io/input/image_decoder.h"
#include "io/input/pixel_patterns.h"
#include "support/sequence_fixture.h"
#include "support/text_files.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

namespace dsorb {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

class ImageInputsTest : public SequenceFixture {
 protected:
  static std::vector<std::uint8_t> encoded(const std::string& suffix,
                                           const cv::Mat& image,
                                           const std::vector<int>& parameters = {}) {
    std::vector<std::uint8_t> bytes;
    EXPECT_TRUE(cv::imencode(suffix, image, bytes, parameters)) << suffix;
    return bytes;
  }
  static std::string decodingComplaint(const std::vector<std::uint8_t>& bytes) {
    try {
      (void)decodeGrey(bytes, "image");
    } catch (const IoError& error) {
      return error.what();
    }
    return "nothing was thrown";
  }
};

TEST_F(ImageInputsTest, EveryKindIsDecodedWhereItIsWhole) {
  const cv::Mat image(48, 66, CV_8UC3, cv::Scalar(10, 100, 200));
  for (const char* suffix : {".png", ".jpg", ".ppm", ".bmp", ".tif", ".webp"}) {
    auto bytes = encoded(suffix, image);
    const cv::Mat grey = decodeGrey(bytes, "image");
    EXPECT_EQ(grey.size(), cv::Size(66, 48)) << suffix;
    EXPECT_NEAR(grey.at<std::uint8_t>(20, 20), 120, 3) << suffix;
    bytes.resize(bytes.size() / 2);
    EXPECT_THAT(decodingComplaint(bytes), HasSubstr("image: the image ")) << suffix;
  }
}

TEST_F(ImageInputsTest, SizesAreChecked) {
  const cv::Mat image(8192, 8193, CV_8UC1, cv::Scalar(0));
  for (const char* suffix : {".png", ".jpg"}) {
    EXPECT_THAT(decodingComplaint(encoded(suffix, image)),
                AllOf(HasSubstr("8193x8192"), HasSubstr("64 megapixels")));
  }
}

TEST_F(ImageInputsTest, ACutJpegOfFourColoursIsRefused) {
  auto bytes = readFile(fs::path(DSORB_CORPUS) / "image" / "cmyk.jpg");
  EXPECT_EQ(decodeGrey(bytes, "image").size(), cv::Size(16, 16));
  bytes.resize(bytes.size() - 20);
  EXPECT_THAT(decodingComplaint(bytes), HasSubstr("truncated or damaged: Premature end"));
}

TEST_F(ImageInputsTest, ScansWithoutEndAreRefused) {
  cv::Mat image(64, 64, CV_8UC1);
  cv::randu(image, 0, 255);
  auto bytes = encoded(".jpg", image, {cv::IMWRITE_JPEG_PROGRESSIVE, 1});
  EXPECT_EQ(decodeGrey(bytes, "image").cols, 64);
  std::size_t scan = bytes.size();
  while (scan-- > 0 && !(bytes[scan] == 0xFF && bytes[scan + 1] == 0xDA)) {
  }
  const std::vector<std::uint8_t> last(bytes.begin() + static_cast<std::ptrdiff_t>(scan),
                                       bytes.end() - 2);
  for (int i = 0; i < 3000; ++i) bytes.insert(bytes.end() - 2, last.begin(), last.end());
  EXPECT_THAT(decodingComplaint(bytes), HasSubstr("more than 100 scans"));
}

TEST_F(ImageInputsTest, FilesOfAnArchiveMayNotBeHuge) {
  writeDso(2);
  fs::create_directories(root() / "bomb");
  fs::copy_file(root() / "images" / "000000.png", root() / "bomb" / "000000.png");
  fs::copy_file(root() / "images" / "000001.png", root() / "bomb" / "000001.png");
  fs::resize_file(root() / "bomb" / "000001.png", std::uintmax_t{300} << 20U);
  zipFolder(root() / "bomb", root() / "bomb.zip");
  EXPECT_LT(fs::file_size(root() / "bomb.zip"), 1U << 20U);
  EXPECT_THAT(readingComplaint(optionsFor(root() / "bomb.zip")),
              AllOf(HasSubstr("000001.png"), HasSubstr("300 MiB are too many")));
}

TEST_F(ImageInputsTest, AVignetteAndAMaskAreNoImages) {
  writeGreyImages(root(), 3, ".png");
  writeText(root() / "camera.txt", "Pinhole 50 50 31.5 23.5 0\n64 48\nnone\n64 48\n");
  writeImage(root() / "vignette.png", cv::Mat(48, 64, CV_16UC1, cv::Scalar(65535)));
  writeImage(root() / "zone 1.png", cv::Mat(48, 64, CV_8UC1, cv::Scalar(255)));
  SequenceOptions o = options();
  EXPECT_THAT(indicesOf(o), ElementsAre(0, 1, 2, 3)) << "nobody says what zone 1.png is";
  o.mask = root() / "zone 1.png";
  EXPECT_THAT(indicesOf(o), ElementsAre(0, 1, 2));
  const SequenceReader reader(o);
  EXPECT_THAT(reader.warnings(), testing::Contains(HasSubstr("vignette.png: not taken for")));
  EXPECT_THAT(reader.warnings(), testing::Contains(HasSubstr("zone 1.png: not taken for")));
}

TEST_F(ImageInputsTest, UnreadableImagesArePassedOverWhereThatIsWanted) {
  writeDso(5);
  writeText(root() / "images" / "000002.png", "no image");
  writeImage(root() / "images" / "000003.png", cv::Mat(24, 32, CV_8UC1, cv::Scalar(0)));
  SequenceOptions o = options();
  EXPECT_THAT(readingComplaint(o), HasSubstr("000002.png"));
  o.skip_unreadable = true;
  SequenceReader reader(o);
  const auto frames = readAll(reader);
  ASSERT_EQ(frames.size(), 3U);
  EXPECT_EQ(frames[2].index, 4);
  EXPECT_THAT(frames[2].warnings,
              ElementsAre(AllOf(HasSubstr("000002.png"), HasSubstr("passed over")),
                          AllOf(HasSubstr("000003.png"), HasSubstr("32x24"))));
  EXPECT_THAT(reader.unreadable(), ElementsAre(HasSubstr("000002.png"), HasSubstr("000003.png")));
}

/// A smooth picture as a sensor with a mosaic of red, green, green and blue gives it.
cv::Mat mosaicOf(const cv::Mat& grey, double red, double blue) {
  cv::Mat mosaic = grey.clone();
  for (int y = 0; y < mosaic.rows; ++y) {
    for (int x = y % 2; x < mosaic.cols; x += 2) {
      auto& pixel = mosaic.at<std::uint8_t>(y, x);
      pixel = cv::saturate_cast<std::uint8_t>(pixel * (y % 2 == 0 ? red : blue));
    }
  }
  return mosaic;
}

TEST_F(ImageInputsTest, MosaicsAreRecognisedAndBecomeGrey) {
  cv::Mat grey(96, 128, CV_8UC1);
  for (int y = 0; y < 96; ++y) {
    for (int x = 0; x < 128; ++x) grey.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(80 + x);
  }
  EXPECT_EQ(isMosaic(grey), false);
  EXPECT_EQ(isMosaic(cv::Mat(96, 128, CV_8UC1, cv::Scalar(2))), std::nullopt);
  cv::Mat noise(96, 128, CV_8UC1);
  cv::randu(noise, 0, 255);
  EXPECT_EQ(isMosaic(noise), false);
  const cv::Mat mosaic = mosaicOf(grey, 0.55, 0.45);
  EXPECT_EQ(isMosaic(mosaic), true);
  cv::Mat deep;
  mosaic.convertTo(deep, CV_16U, 16);
  EXPECT_EQ(isMosaic(deep), true);
  for (int x = 1; x < 127; ++x) {
    EXPECT_NEAR(greyOfMosaic(mosaic).at<std::uint8_t>(50, x), (80 + x) * (2 + 0.55 + 0.45) / 4, 1);
  }
}

TEST_F(ImageInputsTest, RowsOfTwoMomentsAreRecognised) {
  cv::Mat image(240, 320, CV_8UC1);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      image.at<std::uint8_t>(y, x) = cv::saturate_cast<std::uint8_t>(
          128 + 60 * std::sin(0.2 * x) + 50 * std::sin(0.15 * y + 0.1 * x));
    }
  }
  EXPECT_FALSE(isInterlaced(image));
  cv::Mat combed = image.clone();  // the camera turned by 6 px between the two
  for (int y = 1; y < image.rows; y += 2) {
    image.row(y).colRange(6, 320).copyTo(combed.row(y).colRange(0, 314));
  }
  EXPECT_TRUE(isInterlaced(combed));
  cv::Mat bgr;
  cv::merge(std::vector<cv::Mat>(3, combed), bgr);
  EXPECT_TRUE(isInterlaced(bgr));
  writeDso(1);
  writeText(root() / "camera.txt", "Pinhole 250 250 159.5 119.5 0\n320 240\nnone\n320 240\n");
  writeImage(root() / "images" / "000000.png", combed);
  SequenceReader reader(options());
  EXPECT_THAT(reader.next()->warnings, ElementsAre(HasSubstr("000000.png: interlaced")));
}

TEST_F(ImageInputsTest, ASequenceOfMosaicsIsToldOnce) {
  writeDso(3);
  for (int i = 0; i < 3; ++i) {
    const cv::Mat grey(48, 64, CV_8UC1, cv::Scalar(i == 0 ? 1 : 200));  // the first is dark
    writeImage(root() / "images" / ("00000" + std::to_string(i) + ".png"),
               mosaicOf(grey, 0.5, 0.5));
  }
  SequenceReader reader(options());
  const auto frames = readAll(reader);
  ASSERT_EQ(frames.size(), 3U);
  EXPECT_EQ(frames[0].warnings.size(), 0U);
  EXPECT_THAT(frames[1].warnings, ElementsAre(HasSubstr("mosaics of colours")));
  EXPECT_EQ(frames[2].warnings.size(), 0U);
  EXPECT_NEAR(frames[2].frame->level(0).at(20, 20).intensity, 150, 1e-3);
}

}  // namespace
}  // namespace dsorb
